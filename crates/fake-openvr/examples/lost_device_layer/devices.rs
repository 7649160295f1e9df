//! The known instances and devices, and which devices are lost.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use ash::vk;
use ash::vk::Handle;

/// Environment variable with the path of the control file.
const VARIABLE: &str = "LOST_DEVICE_FILE";

/// An instance, with the function of the next layer.
#[derive(Clone, Copy)]
pub struct Instance {
    pub instance: vk::Instance,
    pub get_instance_proc_addr: vk::PFN_vkGetInstanceProcAddr,
}

/// A device.
pub struct Device {
    /// Functions of the next layer.
    pub next: ash::Device,
    pub get_device_proc_addr: vk::PFN_vkGetDeviceProcAddr,
    /// Content of the control file when the device was created; `None` if the file did not exist.
    content_at_creation: Option<Vec<u8>>,
    is_lost: AtomicBool,
}

static INSTANCES: Mutex<BTreeMap<usize, Instance>> = Mutex::new(BTreeMap::new());
static DEVICES: Mutex<BTreeMap<usize, Arc<Device>>> = Mutex::new(BTreeMap::new());

/// Key that is equal for all dispatchable handles of one instance or device: the pointer to the
/// loader's dispatch table.
fn key(handle: u64) -> usize {
    // SAFETY: a dispatchable handle points to a structure that begins with the loader's dispatch
    // table, and the client guarantees live handles.
    unsafe { *(handle as usize as *const usize) }
}

/// Stores an instance.
pub fn add_instance(instance: Instance) {
    INSTANCES.lock().unwrap_or_else(PoisonError::into_inner).insert(key(instance.instance.as_raw()), instance);
}

/// The instance of a handle.
pub fn instance_of(handle: impl Handle) -> Option<Instance> {
    INSTANCES.lock().unwrap_or_else(PoisonError::into_inner).get(&key(handle.as_raw())).copied()
}

/// Stores a device.
pub fn add_device(device: vk::Device, next: ash::Device, get_device_proc_addr: vk::PFN_vkGetDeviceProcAddr) {
    let device_key = key(device.as_raw());
    let made = Device { next, get_device_proc_addr, content_at_creation: content(), is_lost: AtomicBool::new(false) };
    DEVICES.lock().unwrap_or_else(PoisonError::into_inner).insert(device_key, Arc::new(made));
}

/// The device of a handle of the device or one of its queues.
pub fn device_of(handle: impl Handle) -> Option<Arc<Device>> {
    DEVICES.lock().unwrap_or_else(PoisonError::into_inner).get(&key(handle.as_raw())).cloned()
}

/// Removes a device that is about to be destroyed.
pub fn remove_device(device: vk::Device) -> Option<Arc<Device>> {
    DEVICES.lock().unwrap_or_else(PoisonError::into_inner).remove(&key(device.as_raw()))
}

impl Device {
    /// Whether the device is lost.
    pub fn is_lost(&self) -> bool {
        if self.is_lost.load(Ordering::SeqCst) {
            return true;
        }
        let now = content();
        let is_lost = now.is_some() && now != self.content_at_creation;
        if is_lost && !self.is_lost.swap(true, Ordering::SeqCst) {
            // SAFETY: the device is alive; this layer passes no further work to it.
            let _ = unsafe { self.next.device_wait_idle() };
        }
        is_lost
    }
}

/// Content of the control file, if it exists.
fn content() -> Option<Vec<u8>> {
    std::fs::read(PathBuf::from(std::env::var_os(VARIABLE)?)).ok()
}
