#!/usr/bin/env bash
# Makes docs/dashboard.png: the panel in the dashboard after 44 s of play in the simulated room. Runs the real program with the
# simulated sensor and the fake SteamVR runtime. Takes a minute.
set -euo pipefail
cd "$(dirname "$0")/.."
cargo build --release --bin radar-chaperone
cargo build --release -p fake-openvr --examples
folder=$(mktemp -d)
trap 'kill $(jobs -p) 2>/dev/null || true; wait 2>/dev/null || true; rm -rf "$folder"' EXIT
target=$PWD/target/release
mkdir "$folder/home"
export HOME=$folder/home XDG_RUNTIME_DIR=$folder
cd "$folder"
cat >scene.json <<'JSON'
{"events": [
  {"at_s": 40, "do": "dashboard", "open": true},
  {"at_s": 41, "do": "mouse", "action": "move", "x": 640, "y": 1},
  {"at_s": 44, "do": "tab_shot", "name": "dashboard"}]}
JSON
"$target/radar-chaperone" simulate furnished-room --motion natural --seed 7 --serve pty:"$folder/a121" \
    --track-out head.tum --duration-s 70 >/dev/null &
until [ -s head.tum ] && [ -e a121 ]; do sleep 0.1; done
"$target/examples/fake_server" --dir vr --track head.tum --config scene.json >/dev/null &
until [ -e vr/openvrpaths.vrpath ]; do sleep 0.1; done
VR_PATHREG_OVERRIDE=$folder/vr/openvrpaths.vrpath "$target/radar-chaperone" run --port "$folder/a121" \
    --preset d16 --mount 0,0.03,-0.1 >/dev/null 2>&1 &
program=$!
until [ -e vr/shots/dashboard.png ]; do sleep 0.1; done
kill -INT $program
wait $program
cd - >/dev/null
cp "$folder/vr/shots/dashboard.png" docs/dashboard.png
