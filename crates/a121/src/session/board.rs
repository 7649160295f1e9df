//! The board that answered: identified by two equal replies, and checked against the plan.

use super::FIRST_BAUD;
use super::event::Link;
use super::plan::Plan;
use crate::{Prf, SessionError, SystemInfo, Version};

/// Limit of differing replies to the first command before the session restarts. Choice: a line that
/// damages five of six replies carries no results either.
pub(super) const MAX_ANSWERS: usize = 6;

/// Versions up to this one are not supported.
const LAST_UNSUPPORTED: Version = Version::release(0, 2, 0);
const PRF_5_2_SINCE: Version = Version::development(0, 4, 3, 310);
const PRF_15_6_SINCE: Version = Version::development(0, 7, 1, 37);

/// The board that answered.
#[derive(Debug, Clone)]
pub(super) struct Board {
    pub info: SystemInfo,
    pub version: Version,
    /// Baud rate; `None` if the link has no baud rate.
    pub baud: Option<u32>,
}

impl Board {
    /// Checks a board; its baud rate is that of the start of a session.
    pub fn new(info: SystemInfo, plan: &Plan) -> Result<Self, SessionError> {
        let version = check(&info, plan)?;
        let baud = info.max_baudrate.map(|_| FIRST_BAUD).filter(|_| plan.link != Link::Tcp);
        Ok(Self { info, version, baud })
    }

    /// Baud rate to switch to from that of the start, if any.
    pub fn baud_to_set(&self, link: Link) -> Option<u32> {
        match (link, max_baud(&self.info)) {
            (Link::Serial { baud }, Some(max)) => Some(baud.unwrap_or(max)).filter(|&baud| baud != FIRST_BAUD),
            _ => None,
        }
    }
}

/// Highest baud rate of a board, which can do that of the start whatever it says.
fn max_baud(info: &SystemInfo) -> Option<u32> {
    info.max_baudrate.map(|max| max.max(FIRST_BAUD))
}

fn check(info: &SystemInfo, plan: &Plan) -> Result<Version, SessionError> {
    if let Some(sensor) = info.sensor.as_ref().filter(|sensor| *sensor != "a121") {
        return Err(SessionError::WrongSensor(sensor.clone()));
    }
    let found =
        Version::parse(&info.rss_version).ok_or_else(|| SessionError::UnknownVersion(info.rss_version.clone()))?;
    if found <= LAST_UNSUPPORTED {
        return Err(SessionError::TooOld { found, needed: Version::release(0, 2, 1) });
    }
    if info.ticks_per_second == 0 {
        return Err(SessionError::NoTicks);
    }
    for subsweep in plan.setup.sensors().flat_map(|s| &s.config.subsweeps) {
        let needed = match subsweep.prf {
            Prf::Mhz5_2 => PRF_5_2_SINCE,
            Prf::Mhz15_6 => PRF_15_6_SINCE,
            _ => continue,
        };
        if found < needed {
            return Err(SessionError::TooOldForPrf { found, needed, prf_mhz: subsweep.prf.hz() / 1e6 });
        }
    }
    match (plan.link, max_baud(info)) {
        (Link::Serial { baud: Some(asked) }, Some(max)) if !(FIRST_BAUD..=max).contains(&asked) => {
            Err(SessionError::Baud { asked, max })
        }
        _ => Ok(found),
    }
}

/// A verdict on a reply about the board.
pub(super) enum Identified {
    /// Two replies agree.
    Agreed(SystemInfo),
    /// Another reply is needed.
    AskAgain,
    /// Too many replies differ.
    Differ,
}

/// Identifies the board on the line. Replies have no checksum, so two have to agree.
#[derive(Default)]
pub(super) struct Identification {
    /// Different system infos received since the last break.
    infos: Vec<SystemInfo>,
    /// Once two replies agree.
    pub known: Option<Board>,
}

impl Identification {
    pub fn compare(&mut self, info: SystemInfo) -> Identified {
        if self.infos.contains(&info) {
            return Identified::Agreed(info);
        }
        self.infos.push(info);
        if self.infos.len() < MAX_ANSWERS { Identified::AskAgain } else { Identified::Differ }
    }

    /// Version of the board's server; while it is not known, one that is too old for everything.
    pub fn version(&self) -> Version {
        self.known.as_ref().map_or(LAST_UNSUPPORTED, |board| board.version)
    }

    /// Whether the board's line has a baud rate.
    pub fn has_baud(&self) -> bool {
        self.known.as_ref().is_some_and(|board| board.baud.is_some())
    }
}
