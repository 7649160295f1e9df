#!/usr/bin/env python3
"""Licences and bill of materials of the program for one target, from `cargo metadata`.

    packages.py TARGET licenses > THIRD-PARTY-LICENSES.txt
    packages.py TARGET sbom > radar-chaperone.cdx.json

Packages that only build or test the program are left out. The same lock file gives the same bytes.
"""

import collections
import json
import os
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
PROGRAM = "radar-chaperone"
LICENCE_FILE = re.compile(r"(licen[cs]e|copying|copyright|notice|unlicense|ofl|ufl)", re.IGNORECASE)
NOT_A_LICENCE = re.compile(r"\.(rs|py|toml|json|c|h|cpp|hpp|sh|js|ts|yml|yaml|html|png|svg)$", re.IGNORECASE)
# Part of the program without being compiled as a package: build.rs reads its header.
HEADER_PACKAGE = "openvr_sys"


def metadata(target):
    command = ["cargo", "metadata", "--format-version=1", "--locked", "--manifest-path", ROOT / "Cargo.toml"]
    return json.loads(subprocess.check_output(command + ["--filter-platform", target]))


def linked_packages(meta):
    """The packages that are linked into the program, and which of them each uses."""
    by_id = {package["id"]: package for package in meta["packages"]}
    nodes = {node["id"]: node for node in meta["resolve"]["nodes"]}
    waiting = [package["id"] for package in meta["packages"] if package["name"] == PROGRAM]
    uses = {}
    while waiting:
        node = waiting.pop()
        if node in uses:
            continue
        normal = [dep["pkg"] for dep in nodes[node]["deps"] if any(kind["kind"] is None for kind in dep["dep_kinds"])]
        uses[node] = normal
        waiting += normal
    return by_id, uses


def header_package(meta):
    """Its metadata need no target: no target compiles it."""
    found = [package for package in meta["packages"] if package["name"] == HEADER_PACKAGE]
    if found:
        return found[0]
    command = ["cargo", "metadata", "--format-version=1", "--locked", "--manifest-path", ROOT / "Cargo.toml"]
    packages = json.loads(subprocess.check_output(command))["packages"]
    return next(package for package in packages if package["name"] == HEADER_PACKAGE)


def licence_files(folder):
    """Licence texts anywhere in a package: sources of C and fonts have their own."""
    found = []
    for path, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if name not in ("target", "tests", "benches", ".git"))
        found += [pathlib.Path(path) / name for name in files if LICENCE_FILE.match(name) and not NOT_A_LICENCE.search(name)]
    return sorted(found)


def standard_text(package):
    """For a package without a text: that of a licence it names, with its authors."""
    licence = package["license"] or ""
    authors = ", ".join(re.sub(r"\s*<.*?>", "", author) for author in package["authors"]) or f"the authors of {package['name']}"
    if "MIT" in licence:
        text = (ROOT / "LICENSE-MIT").read_text().split("\n")
        start = next(number for number, line in enumerate(text) if line.startswith("Copyright"))
        return "\n".join(text[:start] + [f"Copyright (c) {authors}"] + text[start + 1 :])
    if "Apache-2.0" in licence:
        return (ROOT / "LICENSE-APACHE").read_text()
    sys.exit(f"{package['name']} {package['version']}: no licence text, and none is known for \"{licence}\"")


def licences(meta):
    by_id, uses = linked_packages(meta)
    packages = [by_id[node] for node in uses if by_id[node]["source"]] + [header_package(meta)]
    packages.sort(key=lambda package: (package["name"], package["version"]))
    texts = collections.OrderedDict()
    own = [(f"{PROGRAM} (fonts)", path) for path in licence_files(ROOT / "overlay_assets")]
    for package in packages:
        files = licence_files(pathlib.Path(package["manifest_path"]).parent)
        for path in files or [None]:
            text = path.read_text(errors="replace") if path else standard_text(package)
            name = f"{package['name']} {package['version']}"
            texts.setdefault("\n".join(line.rstrip() for line in text.strip().splitlines()), []).append(name)
    for name, path in own:
        texts.setdefault(path.read_text().strip(), []).append(name)
    print("Radar chaperone contains the packages below. Each comes under the licence named; the texts follow.\n")
    for package in packages:
        source = package["repository"] or f"https://crates.io/crates/{package['name']}"
        print(f"{package['name']} {package['version']}  {package['license']}  {source}")
    print("Rust's standard library  MIT OR Apache-2.0  https://github.com/rust-lang/rust")
    print("on Windows: runtime of mingw-w64 and of GCC  ZPL-2.1 and GPL-3.0 with the GCC runtime library exception  https://www.mingw-w64.org")
    for text, names in texts.items():
        print("\n" + "=" * 100)
        print("\n".join(sorted(set(names))))
        print("-" * 100 + "\n" + text)


def sbom(meta):
    """CycloneDX 1.5."""
    by_id, uses = linked_packages(meta)

    def reference(package):
        return f"pkg:cargo/{package['name']}@{package['version']}"

    def component(package):
        entry = {"type": "library", "bom-ref": reference(package), "name": package["name"], "version": package["version"]}
        entry["purl"] = reference(package)
        if package["license"]:
            expression = package["license"].replace(" / ", " OR ").replace("/", " OR ")
            entry["licenses"] = [{"expression": expression}]
        if package["repository"]:
            entry["externalReferences"] = [{"type": "vcs", "url": package["repository"]}]
        checksum = checksums.get((package["name"], package["version"]))
        if checksum:
            entry["hashes"] = [{"alg": "SHA-256", "content": checksum}]
        return entry

    checksums = {}
    lock = (ROOT / "Cargo.lock").read_text()
    for block in lock.split("[[package]]"):
        fields = dict(re.findall(r'^(name|version|checksum) = "(.*)"$', block, re.MULTILINE))
        if "checksum" in fields:
            checksums[(fields["name"], fields["version"])] = fields["checksum"]
    packages = sorted((by_id[node] for node in uses), key=reference)
    program = next(package for package in packages if package["name"] == PROGRAM)
    graph = [{"ref": reference(by_id[node]), "dependsOn": sorted({reference(by_id[dep]) for dep in deps})} for node, deps in uses.items()]
    document = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {"component": {**component(program), "type": "application"}},
        "components": [component(package) for package in packages if package is not program],
        "dependencies": sorted(graph, key=lambda entry: entry["ref"]),
    }
    print(json.dumps(document, indent=1, ensure_ascii=False))


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[2] not in ("licenses", "sbom"):
        sys.exit(__doc__)
    (licences if sys.argv[2] == "licenses" else sbom)(metadata(sys.argv[1]))
