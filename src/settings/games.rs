//! Settings of single games: the table `games` of a settings file, by SteamVR's application key.
//!
//! `[games."steam.app.546560".warning]` holds what differs in that game. Only what is shown may
//! differ: another mapping would start the map anew with every game.

use super::{Settings, SettingsError, merge_over, with_present_names};

/// Sections that may differ.
const SECTIONS: [&str; 3] = ["warning", "cues", "headset"];
const TABLE: &str = "games";

/// The games' settings, taken out of a file's table.
pub(super) struct Games(toml::Table);

impl Games {
    /// Takes them out of a table.
    ///
    /// # Errors
    /// They are no tables of sections that may differ.
    pub fn take(table: &mut toml::Table) -> Result<Self, SettingsError> {
        let games = match table.remove(TABLE) {
            None => toml::Table::new(),
            Some(toml::Value::Table(games)) => games,
            Some(_) => return Err(wrong("", "write [games.\"KEY\".warning]")),
        };
        for (key, game) in &games {
            let sections = game.as_table().ok_or_else(|| wrong(key, "write [games.\"KEY\".warning]"))?;
            if let Some(other) = sections.keys().find(|section| !SECTIONS.contains(&section.as_str())) {
                return Err(wrong(key, &format!("only warning, cues and headset may differ by game, not {other}")));
            }
        }
        Ok(Self(games))
    }

    /// What differs in a game.
    pub fn of(&self, key: &str) -> Option<toml::Table> {
        self.0.get(key)?.as_table().cloned().map(with_present_names)
    }

    /// Checks the settings of every game over those of the file.
    ///
    /// # Errors
    /// Those of a game are not valid.
    pub fn check(&self, below: &toml::Table) -> Result<(), SettingsError> {
        for key in self.0.keys() {
            let mut table = below.clone();
            merge_over(&mut table, self.of(key).unwrap_or_default());
            let settings = toml::Value::Table(table).try_into::<Settings>().map_err(SettingsError::from);
            settings.and_then(|settings| settings.check()).map_err(|error| wrong(key, &error.to_string()))?;
        }
        Ok(())
    }
}

fn wrong(key: &str, why: &str) -> SettingsError {
    SettingsError::Game { key: key.to_owned(), why: why.to_owned() }
}

/// Names that lead to a setting in a file: through the table of the game, if that sets it.
pub fn path_of(text: &str, game: Option<&str>, name: &str) -> Vec<String> {
    let names: Vec<&str> = name.split('.').collect();
    let sets_it = |game: &str| {
        let file: toml::Value = toml::from_str(text).ok()?;
        names.iter().try_fold(file.get(TABLE)?.get(game)?, |table, name| table.get(name)).map(drop)
    };
    let before = game.filter(|game| sets_it(game).is_some()).map(|game| [TABLE, game]);
    before.into_iter().flatten().chain(names).map(str::to_owned).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "[warning]\nbrightness = 0.5\n[games.\"steam.app.1\".warning]\nbrightness = 0.25\n\
                        [games.\"steam.app.2\".headset]\nwarnings = false\n";

    fn settings(game: Option<&str>, changes: &[String]) -> Settings {
        Settings::for_game(toml::Table::new(), TEXT, changes, game).unwrap()
    }

    #[test]
    fn settings_of_a_game_apply_in_that_game() {
        assert_eq!(settings(None, &[]).warning.brightness, 0.5);
        assert_eq!(settings(Some("steam.app.1"), &[]).warning.brightness, 0.25);
        assert_eq!(settings(Some("steam.app.3"), &[]), settings(None, &[]));
        let other = settings(Some("steam.app.2"), &[]);
        assert_eq!((other.warning.brightness, other.headset.warnings), (0.5, false));
        let changed = settings(Some("steam.app.1"), &["warning.brightness=1".into()]);
        assert_eq!(changed.warning.brightness, 1.0, "the command line overrides both");
    }

    #[test]
    fn invalid_settings_of_any_game_are_refused() {
        for (text, word) in [
            ("games = 1", "write [games"),
            ("[games.\"steam.app.1\"]\nwarning = 1", "expected a table"),
            ("[games.\"steam.app.1\".rooms]", "not rooms"),
            ("[games.\"steam.app.1\".warning]\nbrightness = 7", "brightness"),
            ("[games.\"steam.app.1\".warning]\nbright = 1", "bright"),
        ] {
            let error = Settings::from_toml(text, &[]).expect_err(text).to_string();
            assert!(error.contains(word), "{text}: {error}");
        }
    }

    #[test]
    fn change_goes_where_the_value_is_set() {
        let path = |game, name| path_of(TEXT, game, name).join("/");
        assert_eq!(path(Some("steam.app.1"), "warning.brightness"), "games/steam.app.1/warning/brightness");
        assert_eq!(path(Some("steam.app.1"), "warning.color"), "warning/color");
        assert_eq!(path(Some("steam.app.3"), "warning.brightness"), "warning/brightness");
        assert_eq!(path(None, "warning.brightness"), "warning/brightness");
    }
}
