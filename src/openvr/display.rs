//! The headset's display: frame timing, eyes, and the identity of headset and tracking universe.

use std::time::Duration;

use super::matrix::pose;
use super::runtime::{Runtime, call};
use super::sys::{self, HEADSET};
use radar_sar::geometry::Pose;

/// Used if the headset reports nothing: the rate, and the display time of one frame, seconds.
/// Choice: 90 Hz is the usual rate; one that is wrong by half moves a drawing by milliseconds.
const DEFAULT_FRAME_HZ: f64 = 90.0;
const DEFAULT_VSYNC_TO_PHOTONS_S: f64 = 0.011;

/// When the light of a frame is emitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DisplayTiming {
    /// Frame rate, Hz.
    pub frame_hz: f64,
    /// From the display's vertical sync to the middle of its light, seconds.
    pub vsync_to_photons_s: f64,
}

/// An eye of the headset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadsetEye {
    /// Pose of the eye in the head frame.
    pub head_from_eye: Pose,
    /// Left, right, top, bottom as in `GetProjectionRaw`: top is the lower edge.
    pub tangents: [f64; 4],
}

impl Runtime {
    /// The display's timing.
    pub fn display_timing(&self) -> DisplayTiming {
        let frame_hz = self.float_property(sys::ETrackedDeviceProperty_Prop_DisplayFrequency_Float);
        let photons_s = self.float_property(sys::ETrackedDeviceProperty_Prop_SecondsFromVsyncToPhotons_Float);
        DisplayTiming {
            frame_hz: frame_hz.filter(|hz| (20.0..=1000.0).contains(hz)).unwrap_or(DEFAULT_FRAME_HZ),
            vsync_to_photons_s: photons_s.filter(|s| (0.0..=0.1).contains(s)).unwrap_or(DEFAULT_VSYNC_TO_PHOTONS_S),
        }
    }

    /// Time from now until the light of the frame that is being drawn, seconds.
    pub fn time_to_photons_s(&self, timing: &DisplayTiming) -> f64 {
        let (mut since_s, mut frame) = (0.0f32, 0u64);
        let is_told = call!(self.system, GetTimeSinceLastVsync(&mut since_s, &mut frame));
        let since_s = if is_told && since_s.is_finite() { f64::from(since_s) } else { 0.0 };
        let period_s = 1.0 / timing.frame_hz;
        period_s - since_s.clamp(0.0, period_s) + timing.vsync_to_photons_s
    }

    /// Waits for the next frame, at most `patience`. Returns false if it did not come or the
    /// runtime cannot wait for it.
    pub fn wait_frame(&self, patience: Duration) -> bool {
        let timeout_ms = patience.as_millis().clamp(1, 1000) as u32;
        let Some(overlay) = self.overlay else { return false };
        call!(overlay, WaitFrameSync(timeout_ms)) == sys::EVROverlayError_VROverlayError_None
    }

    /// Left and right eye; `None` if the runtime returns invalid values.
    pub fn eyes(&self) -> Option<[HeadsetEye; 2]> {
        let eye = |which| {
            let head_from_eye = pose(&call!(self.system, GetEyeToHeadTransform(which)))?;
            let mut tangents = [0.0f32; 4];
            let [left, right, top, bottom] = &mut tangents;
            call!(self.system, GetProjectionRaw(which, left, right, top, bottom));
            let tangents = tangents.map(f64::from);
            let [left, right, lower, upper] = tangents;
            let is_sound = tangents.iter().all(|t| t.is_finite() && t.abs() < 100.0) && left < right && lower < upper;
            is_sound.then_some(HeadsetEye { head_from_eye, tangents })
        };
        Some([eye(sys::EVREye_Eye_Left)?, eye(sys::EVREye_Eye_Right)?])
    }

    /// Width and height that the runtime recommends for one eye's image, pixels.
    pub fn eye_size_px(&self) -> [u32; 2] {
        let (mut width, mut height) = (0, 0);
        call!(self.system, GetRecommendedRenderTargetSize(&mut width, &mut height));
        [width, height]
    }

    /// Model of the headset, with its tracking system.
    pub fn headset_name(&self) -> String {
        let maker = self.text_property(sys::ETrackedDeviceProperty_Prop_ManufacturerName_String);
        let model = self.text_property(sys::ETrackedDeviceProperty_Prop_ModelNumber_String);
        let system = self.text_property(sys::ETrackedDeviceProperty_Prop_TrackingSystemName_String);
        let name = [maker, model].into_iter().flatten().collect::<Vec<_>>().join(" ");
        let name = if name.is_empty() { "headset".to_owned() } else { name };
        system.map_or(name.clone(), |system| format!("{name} ({system})"))
    }

    /// Id of the tracking universe, if the runtime has ids. When it changes, all earlier positions are
    /// invalid.
    pub fn universe_id(&self) -> Option<u64> {
        let mut error = 0;
        let property = sys::ETrackedDeviceProperty_Prop_CurrentUniverseId_Uint64;
        let id = call!(self.system, GetUint64TrackedDeviceProperty(HEADSET, property, &mut error));
        // Runtimes without ids were seen to answer 0.
        (error == sys::ETrackedPropertyError_TrackedProp_Success && id != 0).then_some(id)
    }

    fn float_property(&self, property: sys::ETrackedDeviceProperty) -> Option<f64> {
        let mut error = 0;
        let value = call!(self.system, GetFloatTrackedDeviceProperty(HEADSET, property, &mut error));
        (error == sys::ETrackedPropertyError_TrackedProp_Success).then_some(f64::from(value))
    }

    fn text_property(&self, property: sys::ETrackedDeviceProperty) -> Option<String> {
        let (mut error, mut text) = (0, [0u8; 256]);
        let length = call!(
            self.system,
            GetStringTrackedDeviceProperty(HEADSET, property, text.as_mut_ptr().cast(), text.len() as u32, &mut error)
        );
        let is_told = error == sys::ETrackedPropertyError_TrackedProp_Success && length > 1;
        let until = text.iter().position(|byte| *byte == 0).unwrap_or(text.len());
        (is_told && until > 0).then(|| String::from_utf8_lossy(&text[..until]).into_owned())
    }
}
