//! Progress bars on standard error; none when it is not a terminal.

use indicatif::{ProgressBar, ProgressStyle};

/// A bar over a number of steps with a message.
pub fn bar(steps: u64, what: &str) -> ProgressBar {
    let bar = ProgressBar::new(steps);
    let style = ProgressStyle::with_template("{msg:24} [{bar:32}] {percent:>3} %  {eta} left");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()).progress_chars("=> "));
    bar.set_message(what.to_owned());
    bar
}

/// A spinner for work of unknown length.
pub fn spinner(what: &str) -> ProgressBar {
    let spinner = ProgressBar::new_spinner();
    // The default ones are Braille, which the console's fonts on Windows lack. The last one shows the end.
    let style = ProgressStyle::default_spinner().tick_chars("|/-\\ ");
    spinner.set_style(style);
    spinner.set_message(what.to_owned());
    spinner.enable_steady_tick(std::time::Duration::from_millis(120));
    spinner
}
