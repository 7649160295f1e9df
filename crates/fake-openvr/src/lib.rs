//! A fake of SteamVR for tests: `examples/fake_runtime` is the client library that programs load,
//! `examples/fake_server` the server beside it, `examples/lost_device_layer` a Vulkan layer that
//! loses devices on demand. They are examples so that `cargo test` builds them where tests find
//! them. docs/fake-runtime.md is the manual.
