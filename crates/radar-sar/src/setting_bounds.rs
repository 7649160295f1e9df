//! Bounds of settings, stated beside the fields that they bound.

/// The closed interval in which a number of the settings `S` must lie.
#[derive(Debug, Clone, Copy)]
pub struct SettingBound<S> {
    /// Name of the field.
    pub name: &'static str,
    /// Its value.
    pub value: fn(&S) -> f64,
    /// Least allowed value.
    pub min: f64,
    /// Greatest allowed value.
    pub max: f64,
}

/// A setting outside its bounds.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("setting {name} is {value}: it must lie in {min} to {max}")]
pub struct SettingOutOfBounds {
    /// The setting, as in the settings file: table and field.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Least allowed value.
    pub min: f64,
    /// Greatest allowed value.
    pub max: f64,
}

/// Settings whose numbers have bounds.
pub trait BoundedSettings: Sized + 'static {
    /// One per number; [`bounds!`](crate::bounds) writes them.
    const BOUNDS: &'static [SettingBound<Self>];

    /// Whether every number lies within its bounds; `table` is the settings' name in the settings
    /// file. NaN lies in none.
    ///
    /// # Errors
    /// The first one that does not.
    fn check_bounds(&self, table: &str) -> Result<(), SettingOutOfBounds> {
        for SettingBound { name, value, min, max } in Self::BOUNDS {
            let value = value(self);
            if !(*min..=*max).contains(&value) {
                return Err(SettingOutOfBounds { name: format!("{table}.{name}"), value, min: *min, max: *max });
            }
        }
        Ok(())
    }
}

/// [`BoundedSettings::BOUNDS`] from fields of any number type: `bounds![voxel_m: 0.02, 0.5; …]`.
#[macro_export]
macro_rules! bounds {
    ($($field:ident: $min:expr, $max:expr;)*) => {
        &[$($crate::SettingBound {
            name: stringify!($field),
            value: |settings: &Self| settings.$field as f64,
            min: $min,
            max: $max,
        }),*]
    };
}
