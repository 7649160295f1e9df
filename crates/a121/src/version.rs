//! Versions of the sensor's software as boards report them, and their order.
//!
//! `a121-v1.12.0` is 1.12.0. `a121-v1.2.0-4-gc500451b56` was built 4 commits after 1.2.0: it parses
//! as 1.2.1.dev4, which is before 1.2.1. A release candidate, `v1.2.0-rc1`, is before 1.2.0 and
//! after its development builds.

use std::fmt;

/// Stage of a version on the way to the release with its numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Stage {
    Development(u32),
    Candidate(u32),
    Release,
}

/// A version; versions order by release.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version {
    numbers: (u32, u32, u32),
    stage: Stage,
}

impl Version {
    /// The release of these numbers.
    pub const fn release(major: u32, minor: u32, patch: u32) -> Self {
        Self { numbers: (major, minor, patch), stage: Stage::Release }
    }

    /// Development build `dev` on the way to these numbers.
    pub const fn development(major: u32, minor: u32, patch: u32, dev: u32) -> Self {
        Self { numbers: (major, minor, patch), stage: Stage::Development(dev) }
    }

    /// Parses a board's `rss_version`; `None` if it is not a version.
    pub fn parse(rss_version: &str) -> Option<Self> {
        let name = rss_version.strip_prefix("a121-").unwrap_or(rss_version);
        let mut parts = name.strip_prefix('v').unwrap_or(name).split('-');
        let mut numbers = parts.next()?.split('.');
        let mut number = || numbers.next()?.parse::<u32>().ok();
        let (major, minor, patch) = (number()?, number()?, number()?);
        // A fourth field is an explicit development build: 0.4.3.dev280.
        let mut stage = match numbers.next() {
            None => Stage::Release,
            Some(dev) => Stage::Development(dev.strip_prefix("dev")?.parse().ok()?),
        };
        let mut patch_of_stage = patch;
        for part in parts {
            if let Some(candidate) = part.strip_prefix("rc") {
                stage = Stage::Candidate(candidate.parse().ok()?);
            } else if let Ok(commits) = part.parse::<u32>() {
                // Commits after a candidate are still before its release.
                if stage == Stage::Release && commits > 0 {
                    patch_of_stage = patch.checked_add(1)?;
                    stage = Stage::Development(commits);
                }
            } else if !(part == "dirty" || part.starts_with('g')) {
                return None;
            }
        }
        Some(Self { numbers: (major, minor, patch_of_stage), stage })
    }
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (major, minor, patch) = self.numbers;
        write!(f, "{major}.{minor}.{patch}")?;
        match self.stage {
            Stage::Development(dev) => write!(f, ".dev{dev}"),
            Stage::Candidate(candidate) => write!(f, "-rc{candidate}"),
            Stage::Release => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn version_names_of_boards_are_parsed() {
        let cases = [
            ("a121-v1.12.0", Version::release(1, 12, 0)),
            ("a121-v0.4.1", Version::release(0, 4, 1)),
            ("a121-v1.1.0-3-g463f6829e1", Version::development(1, 1, 1, 3)),
            ("v0.4.2-280-gabc", Version::development(0, 4, 3, 280)),
            ("0.4.3.dev310", Version::development(0, 4, 3, 310)),
        ];
        for (name, version) in cases {
            assert_eq!(Version::parse(name), Some(version), "{name}");
        }
        let candidate = Version::parse("a121-v1.2.0-rc1-4-gc500451b56-dirty").unwrap();
        assert!(candidate < Version::release(1, 2, 0) && candidate > Version::development(1, 2, 0, 99));
    }

    #[test]
    fn versions_order_by_release() {
        let rising =
            ["v0.2.0", "v0.4.2", "v0.4.2-1-gaa", "v0.4.2-280-gaa", "v0.4.3", "v0.7.1", "v1.9.0-84-gaa", "v1.12.0"];
        let versions: Vec<_> = rising.iter().map(|name| Version::parse(name).unwrap()).collect();
        assert!(versions.is_sorted_by(|a, b| a < b), "{versions:?}");
    }

    #[test]
    fn invalid_version_names_are_rejected() {
        for name in
            ["", "a121", "v1", "v1.2", "v1.2.x", "v1.2.3.4", "v4294967296.0.0", "v1.2.4294967295-1-g0", "v1.2.3-beta"]
        {
            assert_eq!(Version::parse(name), None, "{name}");
        }
    }
}
