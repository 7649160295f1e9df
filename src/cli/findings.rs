//! What `doctor` found, printed as it is found.

use anyhow::Result;

use crate::app::without_personal_names;

/// Prints each finding, without the user's name, because reports are shown to others, and counts those to be fixed.
#[derive(Default)]
pub(super) struct Findings {
    pub to_fix: u32,
}

impl Findings {
    /// A finding that another process has printed.
    pub fn repeat(&mut self, line: &str) -> Result<()> {
        self.to_fix += u32::from(line.starts_with("fix "));
        outln!("{line}")
    }

    pub fn ok(&self, what: &str, text: &str) -> Result<()> {
        outln!("ok       {what:<12} {}", without_personal_names(text))
    }

    pub fn warn(&self, what: &str, text: &str) -> Result<()> {
        outln!("warning  {what:<12} {}", without_personal_names(text))
    }

    pub fn fix(&mut self, what: &str, text: &str) -> Result<()> {
        self.to_fix += 1;
        outln!("fix      {what:<12} {}", without_personal_names(text))
    }
}
