//! Finds the board's port: from descriptions of USB devices to candidates, most likely first.
//!
//! Boards are recognised by USB ids (XC120, the CP2105 of an XE125, the CH340 of a SparkFun XM125)
//! or by a product string that contains a name such as `XC120`. An XE125 has two ports; the server
//! is on the one called Enhanced. Choosing is pure; only [`list_ports`] and [`boards_without_port`] do I/O.

use std::path::Path;

use serialport::SerialPortType;

use super::{Address, FIRST_BAUD, Link, PortError, TCP_PORT, platform, remedy};
use crate::{LineSpeed, LinkRequirement, preset};

/// Description of a USB device.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct UsbDescription {
    /// Vendor id.
    pub vid: u16,
    /// Product id.
    pub pid: u16,
    /// Serial number.
    pub serial: Option<String>,
    /// Manufacturer string.
    pub manufacturer: Option<String>,
    /// Product string.
    pub product: Option<String>,
    /// Number of the interface within the device.
    pub interface_number: Option<u8>,
    /// Name of the interface.
    pub interface: Option<String>,
}

/// A port of this computer.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct PortDescription {
    /// Path or name that opens it.
    pub path: String,
    /// `None` if the port is not on USB.
    pub usb: Option<UsbDescription>,
}

impl std::fmt::Display for PortDescription {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.path)?;
        let Some(usb) = &self.usb else { return Ok(()) };
        write!(f, " ({:04X}:{:04X}", usb.vid, usb.pid)?;
        let words = [&usb.manufacturer, &usb.product, &usb.interface];
        for word in words.into_iter().flatten().filter(|word| !word.is_empty()) {
            write!(f, ", {word}")?;
        }
        f.write_str(")")
    }
}

/// A kind of board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Board {
    /// XC120 with an XE121, with its own USB.
    Xc120,
    /// XE125 with an XM125, behind a CP2105.
    Xe125,
    /// SparkFun's XM125, behind a CH340, which is reliable only at 115200 baud without flow
    /// control.
    SparkfunXm125,
    /// A device whose product string contains a board name.
    Named,
    /// The server on a Raspberry Pi.
    RaspberryPi,
    /// A port that the user named and that is not recognised.
    Unknown,
}

impl Board {
    /// Name for messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Xc120 => "XC120",
            Self::Xe125 => "XE125 (XM125)",
            Self::SparkfunXm125 => "SparkFun XM125 (CH340)",
            Self::Named => "A121 board",
            Self::RaspberryPi => "Raspberry Pi",
            Self::Unknown => "board",
        }
    }

    /// Whether RTS/CTS is used.
    fn flow_control(self) -> bool {
        self != Self::SparkfunXm125
    }

    /// Type and speed of the link, as far as known before the board answers.
    pub fn line_speed(self, baud: Option<u32>) -> Option<LineSpeed> {
        match (self, baud) {
            (Self::Xc120, _) => Some(LineSpeed::Usb),
            (Self::RaspberryPi, _) => Some(LineSpeed::Network),
            (_, Some(baud)) => Some(LineSpeed::Uart(baud)),
            (Self::Xe125, None) => Some(LineSpeed::Uart(2_000_000)),
            (Self::SparkfunXm125, None) => Some(LineSpeed::Uart(FIRST_BAUD)),
            (Self::Named | Self::Unknown, None) => None,
        }
    }

    /// The preset to use when none is requested.
    pub fn default_preset(self) -> &'static str {
        match self {
            Self::Xc120 | Self::RaspberryPi => "d16",
            Self::Xe125 | Self::Named | Self::Unknown => "c16",
            Self::SparkfunXm125 => "slow-link",
        }
    }
}

/// A port that may have a board.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Which board.
    pub board: Board,
    /// How to open it.
    pub address: Address,
    /// Its USB description, to find it again on another path.
    pub usb: Option<UsbDescription>,
    /// Warnings about it.
    pub warnings: Vec<String>,
}

impl Candidate {
    /// Link of the session, at the given baud rate or the highest usable one.
    pub fn link(&self, baud: Option<u32>) -> Link {
        match (&self.address, self.board) {
            (Address::Tcp(_), _) => Link::Tcp,
            (_, Board::SparkfunXm125) => Link::Serial { baud: Some(baud.unwrap_or(FIRST_BAUD)) },
            _ => Link::Serial { baud },
        }
    }
}

/// Result of a search.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Discovery {
    /// Boards, most likely first.
    pub candidates: Vec<Candidate>,
    /// Ports without a known board, each with the reason.
    pub rejected: Vec<(PortDescription, &'static str)>,
}

/// What the USB ids and strings say about a port.
enum Classification {
    Board(Board),
    Rejected(&'static str),
}

/// Splits ports into candidates and others.
pub fn discover(ports: &[PortDescription]) -> Discovery {
    let mut discovery = Discovery::default();
    for port in ports {
        match classify(port) {
            Classification::Board(board) => discovery.candidates.push(candidate(board, port)),
            Classification::Rejected(reason) => discovery.rejected.push((port.clone(), reason)),
        }
    }
    // Acconeer's own ids first, then names, then chips that other devices use too.
    let rank = |board: Board| match board {
        Board::Xc120 => 0,
        Board::Named => 1,
        Board::Xe125 => 2,
        _ => 3,
    };
    discovery.candidates.sort_by_key(|candidate| (rank(candidate.board), candidate.address.to_string()));
    discovery
}

fn classify(port: &PortDescription) -> Classification {
    let Some(usb) = &port.usb else { return Classification::Rejected("not on USB") };
    let names_xe125 = usb.product.as_deref().is_some_and(|product| product.contains("XE125"));
    match (usb.vid, usb.pid) {
        (0x0483, 0xA42D | 0xA449) | (0xACC0, 0xE121) => Classification::Board(Board::Xc120),
        (0x0483, 0xA41D | 0xA42C) => Classification::Rejected(
            "an XC120 without its software: flash the A121 exploration server with the vendor's tool",
        ),
        (0x10C4, 0xEA70) => xe125(usb),
        _ if names_xe125 => xe125(usb),
        (0x1A86, 0x7523) => Classification::Board(Board::SparkfunXm125),
        _ if usb.product.as_deref().is_some_and(has_board_name) => Classification::Board(Board::Named),
        _ => Classification::Rejected("not a known A121 board"),
    }
}

/// An XE125 has its server on the CP2105's interface 0, called Enhanced; its second port is
/// rejected.
fn xe125(usb: &UsbDescription) -> Classification {
    let name = usb.interface.as_deref().unwrap_or_default().to_ascii_lowercase();
    let is_enhanced = match (name.contains("enhanced"), name.contains("standard")) {
        (is_enhanced, is_standard) if is_enhanced != is_standard => is_enhanced,
        _ => usb.interface_number.is_none_or(|number| number == 0),
    };
    match is_enhanced {
        true => Classification::Board(Board::Xe125),
        false => Classification::Rejected("the XE125's second port: the server is behind the one called Enhanced"),
    }
}

/// Whether the text contains an X, a capital letter and three digits.
fn has_board_name(product: &str) -> bool {
    product
        .as_bytes()
        .windows(5)
        .any(|w| w[0] == b'X' && w[1].is_ascii_uppercase() && w[2..].iter().all(u8::is_ascii_digit))
}

fn candidate(board: Board, port: &PortDescription) -> Candidate {
    let address = Address::Serial { path: port.path.clone(), flow_control: board.flow_control() };
    let warnings = if board == Board::SparkfunXm125 { vec![slow_warning()] } else { Vec::new() };
    Candidate { board, address, usb: port.usb.clone(), warnings }
}

/// Warning about what is possible at 115200 baud.
fn slow_warning() -> String {
    let rate_hz = |name| {
        let need = preset(name).map(|config| LinkRequirement::of(&config));
        need.map_or(0.0, |need| need.predict(LineSpeed::Uart(FIRST_BAUD)).sequential_hz)
    };
    format!(
        "a CH340 is reliable only at {FIRST_BAUD} baud, without flow control: that allows {:.0} frames a second with \
         preset slow-link, {:.0} instead of 500 with c16. Other devices use the same chip",
        rate_hz("slow-link"),
        rate_hz("c16")
    )
}

/// Chooses the board: the requested one (a path, or `tcp:HOST[:PORT]`), else the most likely one.
///
/// # Errors
/// No board, or an invalid address. Whether a named port exists is only known when it is opened.
pub fn choose(asked: Option<&str>, ports: &[PortDescription]) -> Result<Candidate, PortError> {
    let Some(asked) = asked else {
        let found = discover(ports).candidates.into_iter().next();
        return found.ok_or_else(|| PortError::NoBoard { available: describe_ports(ports) });
    };
    if let Some(host) = asked.strip_prefix("tcp:") {
        let address = Address::Tcp(host_and_port(host).ok_or_else(|| PortError::Address(asked.to_owned()))?);
        return Ok(Candidate { board: Board::RaspberryPi, address, usb: None, warnings: Vec::new() });
    }
    // A link such as /dev/serial/by-id/… resolves to the port's path.
    let behind = Path::new(asked).canonicalize().ok();
    let is_asked = |port: &&PortDescription| port.path == asked || behind.as_deref() == Some(Path::new(&port.path));
    let Some(port) = ports.iter().find(is_asked) else {
        let address = Address::Serial { path: asked.to_owned(), flow_control: true };
        return Ok(Candidate { board: Board::Unknown, address, usb: None, warnings: Vec::new() });
    };
    let (board, warning) = match classify(port) {
        Classification::Board(board) => (board, None),
        Classification::Rejected(reason) => (Board::Unknown, Some(reason.to_owned())),
    };
    let mut candidate = candidate(board, port);
    candidate.warnings.extend(warning);
    Ok(candidate)
}

/// `host`, `host:port`, `[::1]:port`.
fn host_and_port(text: &str) -> Option<String> {
    let (host, port) = match text.rsplit_once(':') {
        Some((host, port)) if !port.contains(']') && (!host.contains(':') || host.ends_with(']')) => {
            (host, port.parse().ok().filter(|&port: &u16| port > 0)?)
        }
        _ => (text, TCP_PORT),
    };
    let is_bare_v6 = host.contains(':') && !host.starts_with('[');
    let sound = !host.is_empty() && !host.contains(char::is_whitespace);
    sound.then(|| if is_bare_v6 { format!("[{host}]:{port}") } else { format!("{host}:{port}") })
}

/// Finds the port of the same device after it was plugged in again, whatever its path is now.
pub fn find_replugged<'a>(
    ports: &'a [PortDescription],
    usb: &UsbDescription,
    path: &str,
) -> Option<&'a PortDescription> {
    let same = |port: &&PortDescription| {
        port.usb.as_ref().is_some_and(|other| {
            (other.vid, other.pid, &other.serial, other.interface_number)
                == (usb.vid, usb.pid, &usb.serial, usb.interface_number)
        })
    };
    // Boards without serial numbers differ only by their paths.
    ports.iter().filter(same).find(|port| port.path == path).or_else(|| ports.iter().find(same))
}

/// Text that lists the available USB ports.
pub fn describe_ports(ports: &[PortDescription]) -> String {
    let usb: Vec<String> = ports.iter().filter(|port| port.usb.is_some()).map(ToString::to_string).collect();
    match usb.is_empty() {
        true => "there is no serial port on USB".to_owned(),
        false => format!("there is {}", usb.join(", ")),
    }
}

/// The serial ports of this computer, by path.
pub fn list_ports() -> Vec<PortDescription> {
    // The serialport crate panics if the directory that it reads is missing.
    if cfg!(target_os = "linux") && !Path::new("/sys/class/tty").is_dir() {
        return Vec::new();
    }
    let mut ports: Vec<PortDescription> =
        serialport::available_ports().unwrap_or_default().into_iter().map(port_description).collect();
    ports.sort_by(|a, b| a.path.cmp(&b.path));
    platform::complete_usb(&mut ports);
    ports
}

/// Boards that are plugged in and have no serial port, because another driver has them or none does; each with what to do.
pub fn boards_without_port() -> Vec<PortError> {
    let board = |usb: UsbDescription| match classify(&PortDescription { path: String::new(), usb: Some(usb.clone()) }) {
        Classification::Board(board) => Some(PortError::NoSerialPort {
            device: format!("{} ({:04X}:{:04X})", board.name(), usb.vid, usb.pid),
            remedy: remedy::missing_driver(board),
        }),
        Classification::Rejected(_) => None,
    };
    platform::usb_without_port().into_iter().filter_map(board).collect()
}

fn port_description(port: serialport::SerialPortInfo) -> PortDescription {
    let usb = match port.port_type {
        SerialPortType::UsbPort(usb) => Some(UsbDescription {
            vid: usb.vid,
            pid: usb.pid,
            serial: usb.serial_number,
            manufacturer: usb.manufacturer,
            product: usb.product,
            interface_number: usb.interface,
            interface: None,
        }),
        _ => None,
    };
    PortDescription { path: port.port_name, usb }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn port(path: &str, ids: (u16, u16), product: &str, interface: (u8, &str)) -> PortDescription {
        let usb = UsbDescription {
            vid: ids.0,
            pid: ids.1,
            serial: Some("S1".into()),
            manufacturer: None,
            product: Some(product.into()),
            interface_number: Some(interface.0),
            interface: Some(interface.1.into()),
        };
        PortDescription { path: path.into(), usb: Some(usb) }
    }

    #[test]
    fn boards_are_identified_by_usb_ids_or_product() {
        // USB ids, product, interface; then the board, or a word of the reason for rejection.
        type Row = ((u16, u16), &'static str, (u8, &'static str), Result<Board, &'static str>);
        let table: &[Row] = &[
            ((0x0483, 0xA42D), "", (0, ""), Ok(Board::Xc120)),
            ((0x0483, 0xA449), "Anything", (0, ""), Ok(Board::Xc120)),
            ((0xACC0, 0xE121), "", (2, ""), Ok(Board::Xc120)),
            ((0x0483, 0xA41D), "XC120", (0, ""), Err("flash")),
            ((0x0483, 0xA42C), "", (0, ""), Err("flash")),
            ((0x0483, 0x5740), "STM32 Virtual ComPort", (0, ""), Err("not a known A121 board")),
            ((0x10C4, 0xEA70), "CP2105 Dual USB to UART", (0, "Enhanced Com Port"), Ok(Board::Xe125)),
            ((0x10C4, 0xEA70), "CP2105 Dual USB to UART", (1, "Standard Com Port"), Err("second port")),
            ((0x10C4, 0xEA70), "CP2105 Dual USB to UART", (0, ""), Ok(Board::Xe125)),
            ((0x10C4, 0xEA70), "CP2105 Dual USB to UART", (1, ""), Err("second port")),
            ((0x10C4, 0xEA70), "CP2105 Dual USB to UART", (0, "Dual USB to UART"), Ok(Board::Xe125)),
            ((0x10C4, 0xEA70), "CP2105 Dual USB to UART", (1, "Dual USB to UART"), Err("second port")),
            ((0x10C4, 0xEA60), "CP2102", (0, ""), Err("not a known A121 board")),
            ((0x0403, 0x6010), "XE125", (1, "ENHANCED"), Ok(Board::Xe125)),
            ((0x0403, 0x6010), "XE125", (0, "Standard"), Err("second port")),
            ((0x1A86, 0x7523), "USB Serial", (0, ""), Ok(Board::SparkfunXm125)),
            ((0x1A86, 0x55D4), "USB Single Serial", (0, ""), Err("not a known A121 board")),
            ((0x1234, 0x5678), "Acconeer XC120 rev 2", (0, ""), Ok(Board::Named)),
            ((0x1234, 0x5678), "XM12", (0, ""), Err("not a known A121 board")),
            ((0x1234, 0x5678), "xc120", (0, ""), Err("not a known A121 board")),
        ];
        for (ids, product, interface, expected) in table {
            let discovery = discover(&[port("/dev/ttyX0", *ids, product, *interface)]);
            match expected {
                Ok(board) => assert_eq!(discovery.candidates[0].board, *board, "{ids:x?} {product}"),
                Err(word) => assert!(discovery.rejected[0].1.contains(word), "{ids:x?} {product}: {discovery:?}"),
            }
        }
    }

    #[test]
    fn candidates_are_ranked_and_ch340_is_last_with_a_warning() {
        let ports = [
            port("/dev/ttyUSB2", (0x1A86, 0x7523), "", (0, "")),
            port("/dev/ttyUSB1", (0x10C4, 0xEA70), "", (1, "Standard")),
            port("/dev/ttyUSB0", (0x10C4, 0xEA70), "", (0, "Enhanced")),
            PortDescription { path: "/dev/ttyS0".into(), usb: None },
            port("/dev/ttyACM1", (0x0483, 0xA449), "", (0, "")),
            port("/dev/ttyACM0", (0x0483, 0xA449), "", (0, "")),
        ];
        let discovery = discover(&ports);
        let paths: Vec<String> = discovery.candidates.iter().map(|c| c.address.to_string()).collect();
        assert_eq!(paths, ["/dev/ttyACM0", "/dev/ttyACM1", "/dev/ttyUSB0", "/dev/ttyUSB2"]);
        assert_eq!(discovery.rejected.len(), 2);
        let slow = &discovery.candidates[3];
        assert!(slow.warnings[0].contains("25 frames a second with preset slow-link, 30 instead of 500"), "{slow:?}");
        assert_eq!(slow.address, Address::Serial { path: "/dev/ttyUSB2".into(), flow_control: false });
        assert_eq!(slow.link(None), Link::Serial { baud: Some(115_200) });
        assert_eq!(discovery.candidates[0].link(None), Link::Serial { baud: None });
        assert_eq!(choose(None, &ports).unwrap(), discovery.candidates[0]);
    }

    #[test]
    fn requested_port_overrides_and_is_still_identified() {
        let ports = [
            port("/dev/ttyUSB2", (0x1A86, 0x7523), "", (0, "")),
            port("/dev/ttyUSB1", (0x10C4, 0xEA70), "", (1, "Standard")),
        ];
        assert_eq!(choose(Some("/dev/ttyUSB2"), &ports).unwrap().board, Board::SparkfunXm125);
        let second = choose(Some("/dev/ttyUSB1"), &ports).unwrap();
        assert!(second.board == Board::Unknown && second.warnings[0].contains("Enhanced"));
        let unknown = choose(Some("/dev/ttyNONE7"), &ports).unwrap();
        assert!(unknown.usb.is_none() && unknown.warnings.is_empty());
        let error = choose(None, &ports[1..]).unwrap_err().to_string();
        assert!(error.contains("no A121 board is found: there is /dev/ttyUSB1 (10C4:EA70, Standard)"), "{error}");
        assert!(choose(None, &[]).unwrap_err().to_string().contains("there is no serial port on USB"));
    }

    #[test]
    fn server_addresses_are_parsed() {
        for (text, expected) in [
            ("tcp:pi", Some("pi:6110")),
            ("tcp:10.0.0.7:7000", Some("10.0.0.7:7000")),
            ("tcp:::1", Some("[::1]:6110")),
            ("tcp:[::1]:80", Some("[::1]:80")),
            ("tcp:", None),
            ("tcp::80", None),
            ("tcp:pi:0", None),
            ("tcp:pi:99999", None),
            ("tcp:pi x", None),
        ] {
            let chosen = choose(Some(text), &[]);
            match expected {
                Some(expected) => assert_eq!(chosen.unwrap().address, Address::Tcp(expected.into()), "{text}"),
                None => assert!(matches!(chosen, Err(PortError::Address(_))), "{text}"),
            }
        }
    }

    #[test]
    fn replugged_board_is_found_on_another_path() {
        let before = port("/dev/ttyACM0", (0x0483, 0xA449), "", (0, ""));
        let usb = before.usb.clone().unwrap();
        let mut other = port("/dev/ttyACM0", (0x0483, 0xA449), "", (0, ""));
        other.usb.as_mut().unwrap().serial = Some("S2".into());
        let after = port("/dev/ttyACM1", (0x0483, 0xA449), "", (0, ""));
        let ports = [other, after];
        assert_eq!(find_replugged(&ports, &usb, "/dev/ttyACM0").unwrap().path, "/dev/ttyACM1");
        assert_eq!(find_replugged(&ports[..1], &usb, "/dev/ttyACM0"), None);
    }
}
