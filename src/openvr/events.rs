//! Events of the runtime.

use super::runtime::{Runtime, call};
use super::sys;

/// An event that this program handles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RuntimeEvent {
    /// SteamVR quits: exit within seconds.
    Quit,
    /// The user recentred or set up the room again: the standing universe has moved, or the
    /// universe is another one.
    UniverseMoved,
    /// Colour or distance of the chaperone changed.
    ChaperoneChanged,
    /// Another game is shown, or none.
    GameChanged,
    /// A device was connected or disconnected, or the hand roles changed.
    DevicesChanged,
    /// The headset was taken off.
    Standby,
    /// The headset was put on.
    Awake,
    /// Any other event.
    Other,
}

impl RuntimeEvent {
    fn of(kind: u32) -> Self {
        match kind as sys::EVREventType {
            sys::EVREventType_VREvent_Quit => Self::Quit,
            sys::EVREventType_VREvent_ChaperoneDataHasChanged
            | sys::EVREventType_VREvent_ChaperoneUniverseHasChanged
            | sys::EVREventType_VREvent_ChaperoneRoomSetupCommitted
            | sys::EVREventType_VREvent_ChaperoneFlushCache
            | sys::EVREventType_VREvent_SeatedZeroPoseReset
            | sys::EVREventType_VREvent_StandingZeroPoseReset => Self::UniverseMoved,
            sys::EVREventType_VREvent_ChaperoneSettingsHaveChanged => Self::ChaperoneChanged,
            sys::EVREventType_VREvent_SceneApplicationChanged
            | sys::EVREventType_VREvent_SceneApplicationStateChanged => Self::GameChanged,
            sys::EVREventType_VREvent_TrackedDeviceActivated
            | sys::EVREventType_VREvent_TrackedDeviceDeactivated
            | sys::EVREventType_VREvent_TrackedDeviceRoleChanged => Self::DevicesChanged,
            sys::EVREventType_VREvent_EnterStandbyMode => Self::Standby,
            sys::EVREventType_VREvent_LeaveStandbyMode => Self::Awake,
            _ => Self::Other,
        }
    }
}

impl Runtime {
    /// The next event, if any.
    pub fn next_event(&self) -> Option<RuntimeEvent> {
        let mut event = std::mem::MaybeUninit::<sys::VREvent_t>::zeroed();
        let length = size_of::<sys::VREvent_t>() as u32;
        let is_there = call!(self.system, PollNextEvent(event.as_mut_ptr(), length));
        // SAFETY: all zeros is an event of kind 0, and the kind is a plain number whatever the
        // runtime wrote.
        is_there.then(|| RuntimeEvent::of(unsafe { (*event.as_ptr()).eventType }))
    }

    /// Tells the runtime, after [`RuntimeEvent::Quit`], that this program is exiting and need not be
    /// killed.
    pub fn acknowledge_quit(&self) {
        call!(self.system, AcknowledgeQuit_Exiting());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn event_numbers_match_the_manual() {
        assert_eq!(RuntimeEvent::of(700), RuntimeEvent::Quit);
        assert_eq!(RuntimeEvent::of(801), RuntimeEvent::UniverseMoved);
        assert_eq!(RuntimeEvent::of(808), RuntimeEvent::UniverseMoved);
        assert_eq!(RuntimeEvent::of(803), RuntimeEvent::ChaperoneChanged);
        assert_eq!(RuntimeEvent::of(404), RuntimeEvent::GameChanged);
        assert_eq!(RuntimeEvent::of(108), RuntimeEvent::DevicesChanged);
        assert_eq!(RuntimeEvent::of(u32::MAX), RuntimeEvent::Other);
    }
}
