//! Edits a settings file as a person would: changes one value, keeps comments and everything else.

use std::fs;
use std::io::Write;
use std::path::Path;

use radar_recording::{Existing, Readers, WholeFile};
use toml_edit::{DocumentMut, Item, Table, Value};

/// The text with one value changed; a missing value or table is added. `None`: the text is not
/// TOML, or the path leads through something that is not a table.
pub(super) fn with_value(text: &str, path: &[String], value: &toml::Value) -> Option<String> {
    let mut document: DocumentMut = text.parse().ok()?;
    let (last, path) = path.split_last()?;
    let mut table: &mut dyn toml_edit::TableLike = document.as_table_mut();
    for part in path {
        table = table.entry(part).or_insert(Item::Table(Table::new())).as_table_like_mut()?;
    }
    let mut new = edited(value);
    match table.get_mut(last).and_then(Item::as_value_mut) {
        Some(old) => {
            // Keeps the surrounding whitespace and a comment after the value.
            *new.decor_mut() = old.decor().clone();
            *old = new;
        }
        None => drop(table.insert(last, Item::Value(new))),
    }
    Some(document.to_string())
}

fn edited(value: &toml::Value) -> Value {
    match value {
        toml::Value::String(text) => text.as_str().into(),
        toml::Value::Integer(number) => (*number).into(),
        toml::Value::Float(number) => (*number).into(),
        toml::Value::Boolean(is) => (*is).into(),
        toml::Value::Datetime(time) => time.to_string().into(),
        toml::Value::Array(list) => Value::Array(list.iter().map(edited).collect()),
        toml::Value::Table(table) => {
            Value::InlineTable(table.iter().map(|(key, value)| (key.as_str(), edited(value))).collect())
        }
    }
}

/// Replaces a file atomically: readers see the old text or the new one.
///
/// # Errors
/// Errors of the file system.
pub(super) fn replace(path: &Path, text: &str) -> std::io::Result<()> {
    // For a symbolic link, the target is replaced.
    let path = &fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder)?;
    }
    let (whole, mut file) = WholeFile::create(path, Readers::Usual, Existing::Replace)?;
    if let Ok(metadata) = fs::metadata(path) {
        file.set_permissions(metadata.permissions())?;
    }
    file.write_all(text.as_bytes())?;
    whole.finish(&file)
}

#[cfg(test)]
mod tests {
    use super::{fs, replace};

    fn with_value(text: &str, name: &str, value: &toml::Value) -> Option<String> {
        let path: Vec<String> = name.split('.').map(str::to_owned).collect();
        super::with_value(text, &path, value)
    }

    const TEXT: &str = "# mine\n[warning] # how near\nfade_distance_m = 1.5   # from here\n# bright\nbrightness = 0.5\n\n[headset]\ndisplay = \"panels\"\n";

    #[test]
    fn edit_preserves_comments_and_other_values() {
        let changed = with_value(TEXT, "warning.fade_distance_m", &2.0.into()).unwrap();
        assert_eq!(changed, TEXT.replace("1.5", "2.0"));
        let changed = with_value(TEXT, "headset.display", &"stereo".into()).unwrap();
        assert_eq!(changed, TEXT.replace("panels", "stereo"));
    }

    #[test]
    fn missing_values_are_added() {
        let changed = with_value(TEXT, "warning.footprints", &false.into()).unwrap();
        let lines: Vec<&str> = changed.lines().filter(|line| !TEXT.lines().any(|old| old == *line)).collect();
        assert_eq!(lines, ["footprints = false"]);
        let read: toml::Table = toml::from_str(&changed).unwrap();
        assert_eq!(read["warning"]["footprints"], toml::Value::Boolean(false));
        let color = toml::Value::from(vec![1i64, 2, 3]);
        let fresh = with_value("", "warning.color", &color).unwrap();
        assert_eq!(fresh, "[warning]\ncolor = [1, 2, 3]\n");
        let inline = with_value("warning = { brightness = 0.5 }\n", "warning.brightness", &1.0.into()).unwrap();
        assert_eq!(toml::from_str::<toml::Table>(&inline).unwrap()["warning"]["brightness"], 1.0.into());
    }

    #[test]
    fn unchangeable_names_give_none() {
        assert_eq!(with_value("a = = b", "warning.brightness", &1.0.into()), None);
        assert_eq!(with_value("warning = 3", "warning.brightness", &1.0.into()), None);
    }

    #[test]
    fn file_is_replaced_atomically_and_folder_created() {
        let folder = std::env::temp_dir().join(format!("radar-chaperone-edit-{}", std::process::id()));
        let path = folder.join("deep").join("settings.toml");
        replace(&path, "a = 1\n").unwrap();
        replace(&path, "a = 2\n").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "a = 2\n");
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
        fs::remove_dir_all(&folder).unwrap();
    }
}
