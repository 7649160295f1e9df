//! The instances and devices that there are, and which of the devices are lost.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use ash::vk;
use ash::vk::Handle;

/// Names the file.
const VARIABLE: &str = "LOST_DEVICE_FILE";

/// An instance: how the next one in the chain is asked for its functions.
#[derive(Clone, Copy)]
pub struct Instance {
    pub instance: vk::Instance,
    pub get_instance_proc_addr: vk::PFN_vkGetInstanceProcAddr,
}

/// A device.
pub struct Device {
    /// The next functions in the chain.
    pub next: ash::Device,
    pub get_device_proc_addr: vk::PFN_vkGetDeviceProcAddr,
    /// What the file held when the device was made; `None`: there was none.
    content_at_creation: Option<Vec<u8>>,
    is_lost: AtomicBool,
}

static INSTANCES: Mutex<BTreeMap<usize, Instance>> = Mutex::new(BTreeMap::new());
static DEVICES: Mutex<BTreeMap<usize, Arc<Device>>> = Mutex::new(BTreeMap::new());

/// What tells the dispatchable handles of one instance or device from those of another: the loader's table behind them.
fn key(handle: u64) -> usize {
    // SAFETY: the first word of what a dispatchable handle points to is the loader's table; the client promises living handles.
    unsafe { *(handle as usize as *const usize) }
}

/// Keeps an instance.
pub fn add_instance(instance: Instance) {
    INSTANCES.lock().unwrap_or_else(PoisonError::into_inner).insert(key(instance.instance.as_raw()), instance);
}

/// The instance of a handle.
pub fn instance_of(handle: impl Handle) -> Option<Instance> {
    INSTANCES.lock().unwrap_or_else(PoisonError::into_inner).get(&key(handle.as_raw())).copied()
}

/// Keeps a device.
pub fn add_device(device: vk::Device, next: ash::Device, get_device_proc_addr: vk::PFN_vkGetDeviceProcAddr) {
    let device_key = key(device.as_raw());
    let made = Device { next, get_device_proc_addr, content_at_creation: content(), is_lost: AtomicBool::new(false) };
    DEVICES.lock().unwrap_or_else(PoisonError::into_inner).insert(device_key, Arc::new(made));
}

/// The device of a handle: its own or a queue's.
pub fn device_of(handle: impl Handle) -> Option<Arc<Device>> {
    DEVICES.lock().unwrap_or_else(PoisonError::into_inner).get(&key(handle.as_raw())).cloned()
}

/// Forgets a device that is about to be destroyed.
pub fn remove_device(device: vk::Device) -> Option<Arc<Device>> {
    DEVICES.lock().unwrap_or_else(PoisonError::into_inner).remove(&key(device.as_raw()))
}

impl Device {
    /// Whether it is lost by now.
    pub fn is_lost(&self) -> bool {
        if self.is_lost.load(Ordering::SeqCst) {
            return true;
        }
        let now = content();
        let is_lost = now.is_some() && now != self.content_at_creation;
        if is_lost && !self.is_lost.swap(true, Ordering::SeqCst) {
            // SAFETY: a living device; nothing more is handed to it by way of this layer.
            let _ = unsafe { self.next.device_wait_idle() };
        }
        is_lost
    }
}

/// What the file holds, if it is there.
fn content() -> Option<Vec<u8>> {
    std::fs::read(PathBuf::from(std::env::var_os(VARIABLE)?)).ok()
}
