#!/usr/bin/env bash
# Installs the missing tools for building and testing. Run it as often as you like: if nothing is missing it takes a second
# and changes nothing. Debian and Ubuntu; elsewhere it lists what to install.
#
#   a C compiler                 compresses recordings (zstd)
#   libclang                     reads SteamVR's C header while building the program
#   ALSA's library, pkg-config   sounds of the program, which are off by default
#   Vulkan loader and a driver   pictures; Mesa's software renderer if there is no graphics card. Without them everything
#                                else works, and tests that draw fail.
#   Vulkan's validation layer    one test runs the renderer under it
#   Rust                         cargo as new as rust-version in Cargo.toml, with rustfmt and clippy
set -euo pipefail
cd "$(dirname "$0")"

rust_bin="${CARGO_HOME:-$HOME/.cargo}/bin"
rust_wanted=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml)
say() { echo "setup: $*"; }
have() { command -v "$1" >/dev/null 2>&1; }
have_package() { dpkg -s "$1" 2>/dev/null | grep -q '^Status: install ok installed'; }
have_libclang() {
    [ -n "${LIBCLANG_PATH:-}" ] || ldconfig -p 2>/dev/null | grep -q 'libclang[-.0-9]*\.so' || compgen -G '/usr/lib/llvm-*/lib/libclang[.-][.0-9s]*' >/dev/null
}
have_vulkan_driver() { compgen -G '/usr/share/vulkan/icd.d/*.json' >/dev/null || compgen -G '/etc/vulkan/icd.d/*.json' >/dev/null; }

as_root() {
    if [ "$(id -u)" = 0 ]; then
        "$@"
    elif have sudo; then
        sudo "$@"
    else
        return 1
    fi
}

# True if cargo is installed and new enough.
rust_is_enough() {
    local found
    have cargo || return 1
    found=$(cargo --version 2>/dev/null | cut -d' ' -f2) || return 1
    [ -n "$found" ] && [ "$(printf '%s\n' "$rust_wanted" "$found" | sort -V | head -n1)" = "$rust_wanted" ]
}

# An available libclang1-N, the tested version if possible: the plain name is not a package everywhere.
libclang_package() {
    { apt-cache show libclang1-14 >/dev/null 2>&1 && echo libclang1-14; } ||
        apt-cache search --names-only "^libclang1-[0-9]+\$" 2>/dev/null | cut -d" " -f1 | sort -V | tail -n1 | grep . ||
        echo libclang1-14
}

install_packages() {
    local missing=()
    have cc && have_package libc6-dev || missing+=(gcc libc6-dev)
    have_libclang || missing+=(libclang)
    have pkg-config || missing+=(pkg-config)
    have_package libasound2-dev || missing+=(libasound2-dev)
    have_package libvulkan1 || missing+=(libvulkan1)
    have_vulkan_driver || missing+=(mesa-vulkan-drivers)
    have_package vulkan-validationlayers || missing+=(vulkan-validationlayers)
    if ! rust_is_enough && ! have rustup; then
        have curl || missing+=(curl)
        have_package ca-certificates || missing+=(ca-certificates)
    fi
    [ ${#missing[@]} -gt 0 ] || return 0
    say "installing ${missing[*]}"
    if ! { as_root apt-get update -q && missing=("${missing[@]/#libclang/$(libclang_package)}") &&
        as_root env DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends "${missing[@]}"; }; then
        say "could not install them. As root: apt-get install ${missing[*]}"
    fi
}

install_rust() {
    rust_is_enough && return 0
    if have rustup; then
        say "cargo is older than $rust_wanted: updating Rust for this folder"
        rustup toolchain install stable --profile minimal --component rustfmt --component clippy
        rustup override set stable
        return 0
    fi
    say "installing Rust by its official installer"
    curl --proto '=https' --tlsv1.2 -sSf https://sh.rustup.rs |
        sh -s -- -y --profile minimal --default-toolchain stable --component rustfmt --component clippy
    PATH="$rust_bin:$PATH"
    hash -r
    link_rust
}

# This script cannot change the PATH of the calling shell; as root it links Rust's programs into /usr/local/bin.
link_rust() {
    if [ "$(id -u)" = 0 ] && [ -d /usr/local/bin ]; then
        for program in cargo rustc rustdoc rustfmt cargo-fmt cargo-clippy clippy-driver rustup; do
            [ -e "/usr/local/bin/$program" ] || ln -s "$rust_bin/$program" "/usr/local/bin/$program"
        done
    else
        say "Rust is in $rust_bin: open a new shell, or run: export PATH=\"$rust_bin:\$PATH\""
    fi
}

# Checks the required tools at the end.
check() {
    local fine=0
    have cc || { say "missing: a C compiler (cc)"; fine=1; }
    rust_is_enough || { say "missing: Rust $rust_wanted or newer, see https://rustup.rs"; fine=1; }
    return $fine
}

# Rust may be installed but not yet in the PATH of the calling shell.
if ! have cargo && [ -x "$rust_bin/cargo" ]; then
    PATH="$rust_bin:$PATH"
    link_rust
fi

if have dpkg && have apt-get; then
    install_packages
    install_rust
elif ! check; then
    say "on this system please install: a C compiler, libclang, Rust $rust_wanted (https://rustup.rs), a Vulkan loader and driver (Mesa), Vulkan's validation layer"
    exit 1
fi
check || exit 1
say "all there"
