//! Rust types for SteamVR's interfaces, from Valve's C header, and what the program file has on Windows: icon, version, manifest.

use std::env;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Icon of the program's file on Windows, 256 by 256 pixels.
const ICON: &str = "overlay_assets/icon.png";
/// What Windows is to know before it starts the program.
const WINDOWS_MANIFEST: &str = "release/windows.manifest";

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// Path of another copy of Valve's `openvr_capi.h`.
const HEADER_VARIABLE: &str = "OPENVR_CAPI_H";
/// The interfaces that are used; all that they mention comes with them.
const INTERFACES: &str = "VR_IVR(System|Overlay|Compositor|Applications|Chaperone|Settings)_FnTable";
/// Types that no function names, being behind pointers and numbers without one.
const UNNAMED: &str = "VRVulkanTextureData_t|EVREventType|EVRInitError|EVRApplicationType";
/// Constants: names of interfaces, sections and keys, and their bounds.
const CONSTANTS: &str =
    "IVR(System|Overlay|Compositor|Applications|Chaperone|Settings)_Version|k_pch_CollisionBounds_.*|k_un.*";
/// The header needs these and nothing else of a C library, so that none has to be installed.
const SHIMS: [(&str, &str); 2] = [
    ("stdbool.h", "#define bool _Bool\n#define true 1\n#define false 0\n"),
    (
        "stdint.h",
        "typedef signed char int8_t; typedef short int16_t; typedef int int32_t; typedef long long int64_t;\n\
         typedef unsigned char uint8_t; typedef unsigned short uint16_t; typedef unsigned int uint32_t;\n\
         typedef unsigned long long uint64_t; typedef __INTPTR_TYPE__ intptr_t; typedef __UINTPTR_TYPE__ uintptr_t;\n",
    ),
];

fn main() -> Result<()> {
    println!("cargo::rerun-if-changed=build.rs");
    let out = PathBuf::from(env::var("OUT_DIR")?);
    bind_openvr(&out)?;
    if env::var("CARGO_CFG_TARGET_OS")? == "windows" {
        add_windows_resources(&out)?;
    }
    Ok(())
}

/// Icon, version and manifest of the program file, by binutils' `windres`. Without it, or with another linker, the file has none.
fn add_windows_resources(out: &Path) -> Result<()> {
    println!("cargo::rerun-if-changed={ICON}");
    println!("cargo::rerun-if-changed={WINDOWS_MANIFEST}");
    if env::var("CARGO_CFG_TARGET_ENV")? != "gnu" {
        return Ok(());
    }
    std::fs::write(out.join("program.ico"), icon_file(&std::fs::read(ICON)?))?;
    std::fs::copy(WINDOWS_MANIFEST, out.join("program.manifest"))?;
    std::fs::write(out.join("program.rc"), resource_script()?)?;
    let prefix =
        if cfg!(windows) { String::new() } else { format!("{}-w64-mingw32-", env::var("CARGO_CFG_TARGET_ARCH")?) };
    let object = out.join("program.res.o");
    let done = Command::new(format!("{prefix}windres")).current_dir(out).arg("program.rc").arg(&object).status();
    match done {
        Ok(status) if status.success() => println!("cargo::rustc-link-arg-bins={}", object.display()),
        other => println!("cargo::warning=no icon, version and manifest in the program: {prefix}windres: {other:?}"),
    }
    Ok(())
}

/// An .ico with one picture of 256 pixels, which may be a PNG. Source: Microsoft, "Icons", of Windows Vista and later.
fn icon_file(png: &[u8]) -> Vec<u8> {
    let mut file = vec![0, 0, 1, 0, 1, 0];
    // A side of 256 is written as 0; one plane, 32 bits a pixel.
    file.extend([0, 0, 0, 0, 1, 0, 32, 0]);
    file.extend((png.len() as u32).to_le_bytes());
    file.extend(22u32.to_le_bytes());
    file.extend(png);
    file
}

fn resource_script() -> Result<String> {
    let version = env::var("CARGO_PKG_VERSION")?;
    let numbers = ["MAJOR", "MINOR", "PATCH"].map(|part| env::var(format!("CARGO_PKG_VERSION_{part}")));
    let numbers = numbers.into_iter().collect::<std::result::Result<Vec<_>, _>>()?.join(",");
    // 1 24: the manifest of a program. 0x40004, 1: a program for Windows. 0x409, 1200: US English in UTF-16.
    Ok(format!(
        "1 ICON \"program.ico\"\n1 24 \"program.manifest\"\n1 VERSIONINFO\nFILEVERSION {numbers},0\nPRODUCTVERSION {numbers},0\n\
         FILEOS 0x40004\nFILETYPE 1\nBEGIN\nBLOCK \"StringFileInfo\"\nBEGIN\nBLOCK \"040904B0\"\nBEGIN\n\
         VALUE \"FileDescription\", \"Radar chaperone\"\nVALUE \"FileVersion\", \"{version}\"\n\
         VALUE \"LegalCopyright\", \"MIT OR Apache-2.0\"\nVALUE \"OriginalFilename\", \"radar-chaperone.exe\"\n\
         VALUE \"ProductName\", \"Radar chaperone\"\nVALUE \"ProductVersion\", \"{version}\"\nEND\nEND\n\
         BLOCK \"VarFileInfo\"\nBEGIN\nVALUE \"Translation\", 0x409, 1200\nEND\nEND\n"
    ))
}

/// Writes `openvr.rs`.
fn bind_openvr(out: &Path) -> Result<()> {
    println!("cargo::rerun-if-env-changed={HEADER_VARIABLE}");
    let header = openvr_header()?;
    println!("cargo::rerun-if-changed={}", header.display());
    let shims = out.join("shims");
    std::fs::create_dir_all(&shims)?;
    for (name, text) in SHIMS {
        std::fs::write(shims.join(name), text)?;
    }
    // The header looks for a C++ compiler on Windows by __WIN32 and for a library to link by OPENVR_API_NODLL.
    let bindings = bindgen::builder()
        .header(header.display().to_string())
        .clang_args(["-nostdinc", "-DOPENVR_API_NODLL", "-U__WIN32"])
        .clang_arg(format!("-I{}", shims.display()))
        .allowlist_type(INTERFACES)
        .allowlist_type(UNNAMED)
        .allowlist_var(CONSTANTS)
        .prepend_enum_name(false)
        .generate_comments(false)
        .generate_cstr(true)
        .formatter(bindgen::Formatter::None)
        .generate()?;
    Ok(bindings.write_to_file(out.join("openvr.rs"))?)
}

/// Valve's header in the package `openvr_sys`, which is downloaded and checked with the other packages and never compiled.
fn openvr_header() -> Result<PathBuf> {
    if let Some(header) = env::var_os(HEADER_VARIABLE) {
        return Ok(header.into());
    }
    // What is not needed to build here is not downloaded by then; asking without --offline downloads it.
    let manifest = match manifest_path("openvr_sys", &["--offline"]) {
        Ok(manifest) if manifest.exists() => manifest,
        _ => manifest_path("openvr_sys", &[])?,
    };
    Ok(manifest.with_file_name("openvr").join("headers").join("openvr_capi.h"))
}

/// Path of a package's Cargo.toml by `cargo metadata`.
fn manifest_path(package: &str, arguments: &[&str]) -> Result<PathBuf> {
    let output = Command::new(env::var("CARGO")?)
        .args(["metadata", "--format-version=1", "--locked", "--manifest-path"])
        .arg(Path::new(&env::var("CARGO_MANIFEST_DIR")?).join("Cargo.toml"))
        .args(arguments)
        .output()?;
    let unknown_path =
        || format!("where is {package}? set {HEADER_VARIABLE}. {}", String::from_utf8_lossy(&output.stderr));
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).map_err(|_| unknown_path())?;
    let mut packages = metadata["packages"].as_array().ok_or_else(unknown_path)?.iter();
    let found = packages.find(|found| found["name"] == package).ok_or_else(unknown_path)?;
    Ok(PathBuf::from(found["manifest_path"].as_str().ok_or_else(unknown_path)?))
}
