//! What Windows knows of USB devices: the names that the devices give themselves, and those that have no serial port because
//! another driver has them.

use windows_sys::Win32::Devices::DeviceAndDriverInstallation::{
    CM_Get_Parent, CR_SUCCESS, DICS_FLAG_GLOBAL, DIGCF_ALLCLASSES, DIGCF_PRESENT, DIREG_DEV, HDEVINFO,
    MAX_DEVICE_ID_LEN, SP_DEVINFO_DATA, SetupDiDestroyDeviceInfoList, SetupDiEnumDeviceInfo, SetupDiGetClassDevsW,
    SetupDiGetDeviceInstanceIdW, SetupDiGetDevicePropertyW, SetupDiOpenDevRegKey,
};
use windows_sys::Win32::Devices::Properties::{DEVPKEY_Device_BusReportedDeviceDesc, DEVPROP_TYPE_STRING};
use windows_sys::Win32::Foundation::{ERROR_SUCCESS, INVALID_HANDLE_VALUE};
use windows_sys::Win32::System::Registry::{KEY_READ, RRF_RT_REG_SZ, RegCloseKey, RegGetValueW};
use windows_sys::core::w;

use crate::find::{PortDescription, UsbDescription};
use crate::usb_nodes::{UsbNode, describe_node, nodes_without_port};

/// Most devices looked at. Choice: a computer has some dozens; bounds the time if the system repeats itself.
const MAX_DEVICES: u32 = 4096;
/// Longest text taken, UTF-16 units. Choice: names on USB have at most 126.
const MAX_TEXT: usize = 512;

/// Replaces product, interface and serial number by those that the devices state. The serialport crate gives the name of
/// Windows' driver, and a part of the instance's id as serial number where a device has none.
pub fn complete_usb(ports: &mut [PortDescription]) {
    let nodes = nodes();
    for PortDescription { path, usb } in ports {
        let Some(usb) = usb else { continue };
        let node = nodes.iter().find(|node| node.port.as_ref() == Some(path));
        let Some(known) = node.and_then(|node| describe_node(&nodes, node)) else { continue };
        let driver = usb.product.take();
        // The driver's name also says which of two ports it is: "… Enhanced COM Port (COM5)".
        let interface: Vec<String> = known.interface.iter().chain(&driver).cloned().collect();
        *usb = UsbDescription {
            manufacturer: usb.manufacturer.take(),
            product: known.product.or(driver),
            interface: Some(interface.join(", ")),
            ..known
        };
    }
}

/// USB devices that have no serial port.
pub fn usb_without_port() -> Vec<UsbDescription> {
    nodes_without_port(&nodes())
}

/// The devices on USB that are plugged in.
fn nodes() -> Vec<UsbNode> {
    // SAFETY: a zero-terminated text, and null for "no window".
    let devices = unsafe {
        SetupDiGetClassDevsW(std::ptr::null(), w!("USB"), std::ptr::null_mut(), DIGCF_PRESENT | DIGCF_ALLCLASSES)
    };
    if devices == INVALID_HANDLE_VALUE as HDEVINFO {
        return Vec::new();
    }
    let mut nodes = Vec::new();
    for index in 0..MAX_DEVICES {
        // SAFETY: a plain structure, all zeros being a value of it.
        let mut device: SP_DEVINFO_DATA = unsafe { std::mem::zeroed() };
        device.cbSize = size_of::<SP_DEVINFO_DATA>() as u32;
        // SAFETY: the list is open, and the structure states its size.
        if unsafe { SetupDiEnumDeviceInfo(devices, index, &mut device) } == 0 {
            break;
        }
        nodes.extend(node(devices, &device));
    }
    // SAFETY: the list is open and not used afterwards.
    unsafe { SetupDiDestroyDeviceInfoList(devices) };
    nodes
}

fn node(devices: HDEVINFO, device: &SP_DEVINFO_DATA) -> Option<UsbNode> {
    let (mut id, mut length) = ([0u16; MAX_DEVICE_ID_LEN as usize + 1], 0);
    // SAFETY: the device is of this list; room for as many units as is said.
    if unsafe { SetupDiGetDeviceInstanceIdW(devices, device, id.as_mut_ptr(), id.len() as u32, &mut length) } == 0 {
        return None;
    }
    let mut parent = 0;
    // SAFETY: a variable for the number.
    let has_parent = unsafe { CM_Get_Parent(&mut parent, device.DevInst, 0) } == CR_SUCCESS;
    Some(UsbNode {
        handle: device.DevInst,
        parent: has_parent.then_some(parent),
        id: text(&id),
        name: reported_name(devices, device),
        port: port_name(devices, device),
    })
}

/// The name that the device or the interface gives itself.
fn reported_name(devices: HDEVINFO, device: &SP_DEVINFO_DATA) -> Option<String> {
    let (mut name, mut kind, key) = ([0u16; MAX_TEXT], 0, &DEVPKEY_Device_BusReportedDeviceDesc);
    let length = size_of_val(&name) as u32;
    // SAFETY: the device is of this list; room for as many bytes as is said.
    let found = unsafe {
        let bytes = name.as_mut_ptr().cast();
        SetupDiGetDevicePropertyW(devices, device, key, &mut kind, bytes, length, std::ptr::null_mut(), 0)
    };
    (found != 0 && kind == DEVPROP_TYPE_STRING).then(|| text(&name)).filter(|name| !name.is_empty())
}

/// The name of the device's serial port.
fn port_name(devices: HDEVINFO, device: &SP_DEVINFO_DATA) -> Option<String> {
    // SAFETY: the device is of this list.
    let key = unsafe { SetupDiOpenDevRegKey(devices, device, DICS_FLAG_GLOBAL, 0, DIREG_DEV, KEY_READ) };
    if std::ptr::eq(key, INVALID_HANDLE_VALUE) {
        return None;
    }
    let mut name = [0u16; MAX_TEXT];
    let mut length = size_of_val(&name) as u32;
    // SAFETY: the key is open until the next line; room for as many bytes as is said.
    let found = unsafe {
        let found = RegGetValueW(
            key,
            std::ptr::null(),
            w!("PortName"),
            RRF_RT_REG_SZ,
            std::ptr::null_mut(),
            name.as_mut_ptr().cast(),
            &mut length,
        );
        RegCloseKey(key);
        found
    };
    (found == ERROR_SUCCESS).then(|| text(&name)).filter(|name| !name.is_empty())
}

/// A text up to its zero.
fn text(units: &[u16]) -> String {
    String::from_utf16_lossy(units.split(|unit| *unit == 0).next().unwrap_or_default())
}
