//! Descriptions of USB devices from the nodes that Windows keeps of them. Pure.
//!
//! A device with several functions is a node with a child for each: `USB\VID_10C4&PID_EA70\0123` and, below it,
//! `USB\VID_10C4&PID_EA70&MI_00\6&A694CA9&0&0000`. Source: Microsoft, "Device instance IDs" and "Identifiers for USB devices".

use crate::find::UsbDescription;

/// A node.
#[derive(Debug, Clone, Default)]
pub struct UsbNode {
    /// The system's number of it, and of its parent.
    pub handle: u32,
    pub parent: Option<u32>,
    /// Instance id.
    pub id: String,
    /// The name that the device or the interface gives itself.
    pub name: Option<String>,
    /// Its serial port.
    pub port: Option<String>,
}

/// Vendor, product, and interface of a device with several, as its id states them.
struct Ids {
    vid: u16,
    pid: u16,
    interface: Option<u8>,
}

impl UsbNode {
    fn ids(&self) -> Option<Ids> {
        let mut parts = self.id.strip_prefix("USB\\")?.split('\\').next()?.split('&');
        let vid = u16::from_str_radix(parts.next()?.strip_prefix("VID_")?, 16).ok()?;
        let pid = u16::from_str_radix(parts.next()?.strip_prefix("PID_")?, 16).ok()?;
        let interface = parts.find_map(|part| u8::from_str_radix(part.strip_prefix("MI_")?, 16).ok());
        Some(Ids { vid, pid, interface })
    }

    /// The serial number. Windows makes up an id with `&` where a device has none.
    fn serial(&self) -> Option<String> {
        self.id.rsplit('\\').next().filter(|serial| !serial.contains('&')).map(str::to_owned)
    }
}

/// What the nodes say about the device of one of them.
pub fn describe_node(nodes: &[UsbNode], node: &UsbNode) -> Option<UsbDescription> {
    let Ids { vid, pid, interface } = node.ids()?;
    let device = match interface {
        None => Some(node),
        Some(_) => nodes.iter().find(|other| Some(other.handle) == node.parent),
    };
    Some(UsbDescription {
        vid,
        pid,
        serial: device.and_then(UsbNode::serial),
        manufacturer: None,
        product: device.and_then(|device| device.name.clone()),
        interface_number: interface,
        interface: interface.and(node.name.clone()),
    })
}

/// Devices of which neither they nor their interfaces have a serial port.
pub fn nodes_without_port(nodes: &[UsbNode]) -> Vec<UsbDescription> {
    let has_port = |device: &UsbNode| {
        let mut own = nodes.iter().filter(|node| node.handle == device.handle || node.parent == Some(device.handle));
        own.any(|node| node.port.is_some())
    };
    let devices = nodes.iter().filter(|node| node.ids().is_some_and(|ids| ids.interface.is_none()));
    devices.filter(|device| !has_port(device)).filter_map(|device| describe_node(nodes, device)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(handle: u32, parent: u32, id: &str, name: &str, port: &str) -> UsbNode {
        let text = |text: &str| (!text.is_empty()).then(|| text.to_owned());
        UsbNode { handle, parent: Some(parent), id: id.to_owned(), name: text(name), port: text(port) }
    }

    fn nodes() -> Vec<UsbNode> {
        vec![
            node(1, 0, "USB\\ROOT_HUB30\\4&1B6C5F1F&0&0", "", ""),
            node(2, 1, "USB\\VID_10C4&PID_EA70\\01AB23", "CP2105 Dual USB to UART Bridge Controller", ""),
            node(3, 2, "USB\\VID_10C4&PID_EA70&MI_00\\6&A694CA9&0&0000", "Enhanced Com Port", "COM5"),
            node(4, 2, "USB\\VID_10C4&PID_EA70&MI_01\\6&A694CA9&0&0001", "Standard Com Port", "COM6"),
            node(5, 1, "USB\\VID_1A86&PID_7523\\5&2C8C3AB&0&2", "USB Serial", "COM7"),
            node(6, 1, "USB\\VID_0483&PID_A42D\\S1", "XC120", ""),
            node(7, 6, "USB\\VID_0483&PID_A42D&MI_00\\6&1&0&0000", "", ""),
        ]
    }

    #[test]
    fn interfaces_get_name_and_serial_number_of_their_device() {
        let nodes = nodes();
        let enhanced = describe_node(&nodes, &nodes[2]).unwrap();
        assert_eq!((enhanced.vid, enhanced.pid, enhanced.interface_number), (0x10C4, 0xEA70, Some(0)));
        assert_eq!(enhanced.serial.as_deref(), Some("01AB23"));
        assert_eq!(enhanced.product.as_deref(), Some("CP2105 Dual USB to UART Bridge Controller"));
        assert_eq!(enhanced.interface.as_deref(), Some("Enhanced Com Port"));
        let single = describe_node(&nodes, &nodes[4]).unwrap();
        assert_eq!((single.serial, single.interface, single.interface_number), (None, None, None));
        assert_eq!(single.product.as_deref(), Some("USB Serial"));
        assert!(describe_node(&nodes, &nodes[0]).is_none());
        // Without its parent an interface says no less than its ids.
        let orphan = describe_node(&nodes[2..3], &nodes[2]).unwrap();
        assert_eq!((orphan.pid, orphan.serial, orphan.product), (0xEA70, None, None));
    }

    #[test]
    fn only_a_device_without_any_port_lacks_one() {
        let without = nodes_without_port(&nodes());
        let ids: Vec<(u16, u16)> = without.iter().map(|usb| (usb.vid, usb.pid)).collect();
        assert_eq!(ids, [(0x0483, 0xA42D)]);
        assert_eq!((without[0].serial.as_deref(), without[0].product.as_deref()), (Some("S1"), Some("XC120")));
        for id in ["", "USB\\", "USB\\VID_04&PID_", "USB\\VID_XYZ&PID_A42D\\1", "PCI\\VID_0483&PID_A42D\\1"] {
            assert!(nodes_without_port(&[node(1, 0, id, "", "")]).is_empty(), "{id}");
        }
    }
}
