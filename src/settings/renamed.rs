//! Names that settings had before, and settings that are no more, so that files and recordings of before still open.

use toml::{Table, Value};

/// Old and new path, in the order in which they are applied: a table's own name after the names in
/// it.
const RENAMED: [(&str, &str); 26] = [
    ("rooms.blocks.block_s", "rooms.blocks.duration_s"),
    ("rooms.blocks.memory_s", "rooms.blocks.decay_s"),
    ("rooms.blocks.mirror_min_amplitude", "rooms.blocks.plane_min_amplitude"),
    ("rooms.blocks", "rooms.subapertures"),
    ("rooms.explain.plane_min_blocks", "rooms.explain.plane_min_subapertures"),
    ("rooms.explain.claim_range_m", "rooms.explain.mask_range_m"),
    ("rooms.explain.claim_lobes", "rooms.explain.mask_lobes"),
    ("rooms.explain", "rooms.clean"),
    ("rooms.map.confirm_sightings", "rooms.map.confirm_observations"),
    ("rooms.map.confirm_wall_sightings", "rooms.map.confirm_wall_observations"),
    ("rooms.map.confirm_odds", "rooms.map.confirm_log_odds"),
    ("rooms.map.forget.confirm", "rooms.map.forget.confirm_log_odds"),
    ("rooms.map.forget.newly", "rooms.map.forget.initial_share"),
    ("rooms.map.forget.most", "rooms.map.forget.max_log_odds"),
    ("rooms.map.forget.familiar", "rooms.map.forget.detection_seen_side"),
    ("rooms.map.forget.familiar_blocks", "rooms.map.forget.detection_prior_subapertures"),
    ("rooms.map.forget.unfamiliar", "rooms.map.forget.detection_new_side"),
    ("rooms.map.forget.leak", "rooms.map.forget.loss"),
    ("rooms.map.forget.shadow_leak", "rooms.map.forget.masked_loss"),
    ("rooms.map.forget.beside", "rooms.map.forget.neighbour_log_odds"),
    ("rooms.map.forget", "rooms.map.existence"),
    ("rooms.map", "rooms.tracks"),
    ("rooms.fine.keep_looks", "rooms.fine.keep_updates"),
    ("rooms.moving.alarms_per_block", "rooms.moving.alarms_per_subaperture"),
    ("rooms.moving.confirm_blocks", "rooms.moving.confirm_subapertures"),
    ("rooms.moving.forget_s", "rooms.moving.drop_after_s"),
];

/// Settings that are no more, by the names that they had at the end of the renaming.
const REMOVED: [&str; 2] = ["rooms.clean.amplitude_spread_cost", "rooms.clean.uneven_cost"];

/// Gives every setting its present name, and leaves out those that are no more. Where a file holds both names, the
/// present one counts.
pub(super) fn with_present_names(mut settings: Table) -> Table {
    for (old, new) in RENAMED {
        if let Some(value) = take(&mut settings, old) {
            put(&mut settings, new, value);
        }
    }
    for name in REMOVED {
        if take(&mut settings, name).is_some() {
            log::warn!("the setting {name} exists no longer and is ignored");
        }
    }
    settings
}

/// Removes what stands at a path.
fn take(table: &mut Table, path: &str) -> Option<Value> {
    match path.split_once('.') {
        None => table.remove(path),
        Some((first, rest)) => take(table.get_mut(first)?.as_table_mut()?, rest),
    }
}

/// Puts a value at a path; what is there already stays.
pub(super) fn put(table: &mut Table, path: &str, value: Value) {
    match path.split_once('.') {
        None => match (table.get_mut(path), value) {
            (Some(Value::Table(present)), Value::Table(old)) => {
                old.into_iter().for_each(|(name, value)| put(present, &name, value));
            }
            (Some(_), _) => {}
            (None, value) => drop(table.insert(path.to_owned(), value)),
        },
        Some((first, rest)) => {
            if let Some(inner) = table.entry(first).or_insert_with(|| Value::Table(Table::new())).as_table_mut() {
                put(inner, rest, value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;

    fn names(table: &Table, before: &str, into: &mut Vec<String>) {
        for (name, value) in table {
            let path = format!("{before}{name}");
            match value {
                Value::Table(inner) => names(inner, &format!("{path}."), into),
                _ => into.push(path),
            }
        }
    }

    #[test]
    fn every_old_name_sets_the_present_setting() {
        let defaults = Table::try_from(Settings::default()).unwrap();
        let mut present = Vec::new();
        names(&defaults, "", &mut present);
        let is_table = |path: &str| RENAMED.iter().any(|(other, _)| other.starts_with(&format!("{path}.")));
        for (old, _) in RENAMED.iter().filter(|(old, _)| !is_table(old)) {
            let mut settings = Table::new();
            put(&mut settings, old, Value::Integer(1));
            let mut renamed = Vec::new();
            names(&with_present_names(settings), "", &mut renamed);
            assert!(renamed.len() == 1 && present.contains(&renamed[0]), "{old} became {renamed:?}");
        }
    }

    #[test]
    fn settings_written_with_the_names_of_before_are_read() {
        let text = "[rooms.blocks]\nmemory_s = 2.0\n[rooms.map]\nconfirm_odds = 1.2\n[rooms.map.forget]\nmost = 5.0";
        let settings = Settings::from_toml(text, &[]).unwrap();
        assert_eq!(settings.rooms.subapertures.decay_s, 2.0);
        assert_eq!(settings.rooms.tracks.confirm_log_odds, 1.2);
        assert_eq!(settings.rooms.tracks.existence.max_log_odds, 5.0);
    }

    #[test]
    fn settings_that_are_no_more_are_ignored() {
        let text = "[rooms.explain]\nuneven_cost = 2.0\n[rooms.clean]\namplitude_spread_cost = 1.0\nwindow_s = 5.0";
        assert_eq!(Settings::from_toml(text, &[]).unwrap().rooms.clean.window_s, 5.0);
    }

    #[test]
    fn changes_may_use_either_name_and_override_the_text() {
        let text = "[rooms.map]\nconfirm_odds = 1.2";
        for name in ["rooms.map.confirm_odds", "rooms.tracks.confirm_log_odds"] {
            let settings = Settings::from_toml(text, &[format!("{name}=0.7")]).unwrap();
            assert_eq!(settings.rooms.tracks.confirm_log_odds, 0.7, "{name}");
        }
    }

    #[test]
    fn the_present_name_counts_where_both_are_given() {
        let text = "[rooms.map]\nconfirm_odds = 1.2\n[rooms.tracks]\nconfirm_log_odds = 0.5";
        assert_eq!(Settings::from_toml(text, &[]).unwrap().rooms.tracks.confirm_log_odds, 0.5);
    }

    #[test]
    fn a_value_where_a_table_is_expected_is_refused() {
        assert!(Settings::from_toml("rooms = 1", &[]).is_err());
        assert!(Settings::from_toml("[rooms]\nmap = 1", &[]).is_err());
    }
}
