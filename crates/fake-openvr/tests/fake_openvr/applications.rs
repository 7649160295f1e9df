//! Manifests, autolaunch, and their persistence.

use std::ffi::{CString, c_char};
use std::path::Path;

use serde_json::{Value, json};

use crate::rig::{Server, alone, folder, until};
use crate::runtime::{Runtime, call, text};
use crate::sys;

const KEY: &std::ffi::CStr = c"test.application";

fn manifest(binary: &str, arguments: &str) -> Value {
    json!({ "source": "builtin", "applications": [{
        "app_key": "test.application",
        "launch_type": "binary",
        "binary_path_linux": binary,
        "arguments": arguments,
        "is_dashboard_overlay": true,
        "strings": { "en_us": { "name": "A test", "description": "What tests do." } },
    }]})
}

fn write(path: &Path, manifest: &Value) -> CString {
    std::fs::write(path, manifest.to_string()).unwrap();
    CString::new(path.display().to_string()).unwrap()
}

fn binary_path(runtime: &Runtime) -> (String, u32) {
    let (mut value, mut error) = ([0u8; 256], 0);
    let asked = sys::EVRApplicationProperty_VRApplicationProperty_BinaryPath_String;
    let (value_at, table) = (value.as_mut_ptr().cast::<c_char>(), runtime.applications);
    let needed = call!(table, GetApplicationPropertyString, text(KEY), asked, value_at, 256, &mut error);
    (String::from_utf8_lossy(&value[..(needed.max(1) - 1) as usize]).into_owned(), error)
}

#[test]
fn applications_persist_across_sessions() {
    alone("applications::applications_persist_across_sessions", &json!({}), |rig| {
        let runtime = Runtime::connected_as(sys::EVRApplicationType_VRApplication_Utility);
        let table = runtime.applications;
        let path = write(&rig.folder.join("test.vrmanifest"), &manifest("bin/program", "run --now"));
        assert!(!call!(table, IsApplicationInstalled, text(KEY)));
        assert_eq!(call!(table, AddApplicationManifest, text(&path), false), 0);
        assert_eq!(call!(table, SetApplicationAutoLaunch, text(KEY), true), 0);
        assert_eq!(call!(table, IdentifyApplication, 4711, text(KEY)), 0);
        runtime.cleanup();
        assert_eq!(runtime.init_as(sys::EVRApplicationType_VRApplication_Background), 0);
        assert!(call!(table, IsApplicationInstalled, text(KEY)) && call!(table, GetApplicationAutoLaunch, text(KEY)));
        assert_eq!(call!(table, GetApplicationProcessId, text(KEY)), 4711);
        assert_eq!(binary_path(&runtime), (rig.folder.join("bin/program").display().to_string(), 0));
        assert_eq!(call!(table, RemoveApplicationManifest, text(&path)), 0);
        assert!(!call!(table, IsApplicationInstalled, text(KEY)));
        assert_eq!(binary_path(&runtime).1, sys::EVRApplicationError_VRApplicationError_UnknownApplication);
        let again = call!(table, RemoveApplicationManifest, text(&path));
        assert_eq!(again, sys::EVRApplicationError_VRApplicationError_NoManifest);
        runtime.cleanup();
    });
}

#[test]
fn utility_registers_without_a_server() {
    alone("applications::utility_registers_without_a_server", &json!({}), |rig| {
        rig.kill_server();
        let runtime = Runtime::connected_as(sys::EVRApplicationType_VRApplication_Utility);
        let path = write(&rig.folder.join("test.vrmanifest"), &manifest("program", ""));
        assert_eq!(call!(runtime.applications, AddApplicationManifest, text(&path), false), 0);
        assert!(call!(runtime.applications, IsApplicationInstalled, text(KEY)));
        assert!(!runtime.poses(sys::ETrackingUniverseOrigin_TrackingUniverseStanding, 0.0)[0].bDeviceIsConnected);
        runtime.cleanup();
    });
}

#[test]
fn bad_manifests_are_rejected() {
    alone("applications::bad_manifests_are_rejected", &json!({}), |rig| {
        let runtime = Runtime::connected();
        let add = |path: &CString| call!(runtime.applications, AddApplicationManifest, text(path), false);
        let missing = CString::new(rig.folder.join("missing.vrmanifest").display().to_string()).unwrap();
        assert_eq!(add(&missing), sys::EVRApplicationError_VRApplicationError_NoManifest);
        assert_eq!(add(&c"a/relative/path".to_owned()), sys::EVRApplicationError_VRApplicationError_NoManifest);
        let file = rig.folder.join("bad.vrmanifest");
        let mut no_key = manifest("program", "");
        no_key["applications"][0]["app_key"] = json!("");
        let mut no_binary = manifest("program", "");
        no_binary["applications"][0].as_object_mut().unwrap().remove("binary_path_linux");
        let (bad, bad_application) = (
            sys::EVRApplicationError_VRApplicationError_InvalidManifest,
            sys::EVRApplicationError_VRApplicationError_InvalidApplication,
        );
        assert_eq!(add(&write(&file, &json!({ "applications": [] }))), bad);
        assert_eq!(add(&write(&file, &json!("no manifest"))), bad);
        assert_eq!(add(&write(&file, &no_key)), bad_application);
        assert_eq!(add(&write(&file, &no_binary)), bad_application);
        assert_eq!(call!(runtime.applications, GetApplicationCount), 0);
        let path = write(&file, &manifest("program", ""));
        assert_eq!(add(&path), 0);
        let other = write(&rig.folder.join("other.vrmanifest"), &manifest("program", ""));
        assert_eq!(add(&other), sys::EVRApplicationError_VRApplicationError_AppKeyAlreadyExists);
        runtime.cleanup();
    });
}

#[test]
fn autolaunch_applications_start_with_the_server() {
    let folder = folder("autolaunch");
    let told = folder.join("told");
    std::fs::create_dir_all(folder.join("runtime")).unwrap();
    let application = |autolaunch, file: &Path| {
        json!({ "manifest": "/m", "temporary": false, "autolaunch": autolaunch, "name": "", "description": "",
            "binary": "/bin/sh", "arguments": format!("-c \"echo $VR_PATHREG_OVERRIDE > {0}.new; mv {0}.new {0}\"",
            file.display()), "is_dashboard_overlay": true })
    };
    let applications = json!({ "a": application(true, &told), "b": application(false, &folder.join("never")) });
    std::fs::write(folder.join("runtime/applications.json"), applications.to_string()).unwrap();
    let server = Server::start(folder.clone(), &json!({}), &["--autolaunch"]);
    let text = until("the application", || std::fs::read_to_string(&told).ok());
    assert_eq!(text.trim(), folder.canonicalize().unwrap().join("openvrpaths.vrpath").display().to_string());
    assert!(!folder.join("never").exists());
    drop(server);
}
