//! IVRChaperone: the user's play area and the colour of its bounds.

use std::ffi::c_int;

use crate::memory::{write, write_all};
use crate::table::table;
use crate::world::{World, call};
use crate::{sys, table};

unsafe extern "C" fn calibration_state() -> u32 {
    call("GetCalibrationState", sys::ChaperoneCalibrationState_Error, |world| world.config.chaperone.calibration)
}

fn size(world: &mut World) -> Option<[f32; 2]> {
    world.config.chaperone.size_m.filter(|_| world.server.alive(crate::clock::now_ns()))
}

unsafe extern "C" fn play_area_size(x: *mut f32, z: *mut f32) -> bool {
    call("GetPlayAreaSize", 0, |world| {
        let Some([size_x, size_z]) = size(world) else { return false };
        write(x, size_x);
        write(z, size_z);
        true
    })
}

unsafe extern "C" fn play_area_rect(rect: *mut sys::HmdQuad_t) -> bool {
    call("GetPlayAreaRect", 0, |world| {
        let Some([size_x, size_z]) = size(world) else { return false };
        let (x, z) = (size_x / 2.0, size_z / 2.0);
        let corner = |x, z| sys::HmdVector3_t { v: [x, 0.0, z] };
        write(rect, sys::HmdQuad_t { vCorners: [corner(x, z), corner(-x, z), corner(-x, -z), corner(x, -z)] });
        true
    })
}

unsafe extern "C" fn reload_info() {
    call("ReloadInfo", 0, |_| ());
}

unsafe extern "C" fn bounds_color(out: *mut sys::HmdColor_t, count: c_int, _fade_m: f32, camera: *mut sys::HmdColor_t) {
    call("GetBoundsColor", 0, |world| {
        if out.is_null() || camera.is_null() {
            return world.report.violation("null pointer", "GetBoundsColor");
        }
        let [r, g, b, a] = world.settings.bounds_color();
        let color = sys::HmdColor_t { r, g, b, a };
        write_all(out, count.clamp(0, 256) as u32, &[], color);
        write(camera, color);
    });
}

unsafe extern "C" fn bounds_visible() -> bool {
    call("AreBoundsVisible", 0, |_| false)
}

/// IVRChaperone_004.
pub fn new_table() -> usize {
    table::leaked(table! { VR_IVRChaperone_FnTable, "IVRChaperone";
        given {
            GetCalibrationState: calibration_state,
            GetPlayAreaSize: play_area_size,
            GetPlayAreaRect: play_area_rect,
            ReloadInfo: reload_info,
            GetBoundsColor: bounds_color,
            AreBoundsVisible: bounds_visible,
        }
        fails(0) { SetSceneColor, ForceBoundsVisible, ResetZeroPose }
    })
}
