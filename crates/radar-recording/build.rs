//! Rust types for the messages in `proto`, with the descriptors that every recording carries as its schemas. protox is a
//! compiler written in Rust, so protoc need not be installed.

use std::env;
use std::error::Error;
use std::path::{Path, PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=proto");
    let out = PathBuf::from(env::var("OUT_DIR")?);
    compile_messages(&out)
}

fn compile_messages(out: &Path) -> Result<(), Box<dyn Error>> {
    // Each file by itself: a recording carries the descriptors of what is in it.
    for name in ["radar_chaperone", "results"] {
        let mut compiler = protox::Compiler::new(["proto"])?;
        compiler.include_imports(true).open_file(format!("{name}.proto"))?;
        std::fs::write(out.join(format!("{name}.descriptors")), compiler.encode_file_descriptor_set())?;
        prost_build::Config::new().out_dir(out).compile_fds(compiler.file_descriptor_set())?;
    }
    Ok(())
}
