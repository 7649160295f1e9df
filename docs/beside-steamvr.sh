#!/usr/bin/env bash
# Makes docs/beside-steamvr.png: both eyes' views of a chair in the simulated room, for each display mode. Runs the real program with
# the simulated sensor and the fake SteamVR runtime. Takes half a minute.
set -euo pipefail
cd "$(dirname "$0")/.."
cargo build --release --bin radar-chaperone
cargo build --release -p fake-openvr --examples
cargo build --release -p lab --example steamvr_picture
folder=$(mktemp -d)
trap 'kill $(jobs -p) 2>/dev/null || true; wait 2>/dev/null || true; rm -rf "$folder"' EXIT
target=$PWD/target/release
mkdir "$folder/home"
export HOME=$folder/home XDG_RUNTIME_DIR=$folder
cd "$folder"
cat >scene.json <<'JSON'
{"display": {"floor_grid": true}, "settings": {"collisionBounds": {"CollisionBoundsFadeDistance": 1.5}},
 "events": [{"at_s": 6.5, "do": "shot", "name": "chair"}]}
JSON
for display in panels stereo projection; do
    rm -f head.tum a121
    "$target/radar-chaperone" simulate furnished-room --motion approach-chair --serve pty:"$folder/a121" \
        --track-out head.tum --duration-s 30 >/dev/null &
    sensor=$!
    until [ -s head.tum ] && [ -e a121 ]; do sleep 0.1; done
    "$target/examples/fake_server" --dir $display --track head.tum --config scene.json >/dev/null &
    server=$!
    until [ -e $display/openvrpaths.vrpath ]; do sleep 0.1; done
    VR_PATHREG_OVERRIDE=$folder/$display/openvrpaths.vrpath "$target/radar-chaperone" run --port "$folder/a121" \
        --preset d16 --mount 0,0.03,-0.1 --set headset.display=$display >/dev/null 2>&1 &
    program=$!
    until [ -e $display/shots/chair.json ]; do sleep 0.1; done
    kill -INT $program
    wait $program
    kill $server $sensor
    wait $server $sensor 2>/dev/null || true
done
cd - >/dev/null
"$target/examples/steamvr_picture" docs/beside-steamvr.png "$folder"/{panels,stereo,projection}/shots/chair
