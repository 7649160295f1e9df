//! Compiles proto/: Rust types for prost, and the descriptors that every recording carries as its schemas.
//! protox is a compiler written in Rust, so nobody has to install protoc.

use std::error::Error;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=proto");
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    let mut compiler = protox::Compiler::new(["proto"])?;
    compiler.include_imports(true).open_file("radar_chaperone.proto")?;
    std::fs::write(out.join("radar_chaperone.descriptors"), compiler.encode_file_descriptor_set())?;
    prost_build::Config::new().out_dir(out).compile_fds(compiler.file_descriptor_set())?;
    Ok(())
}
