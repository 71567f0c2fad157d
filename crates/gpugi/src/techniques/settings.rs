//! Typed settings that people and programs set by name.

use serde::{Serialize, de::DeserializeOwned};

/// One setting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Field {
    /// Name in `--set technique.NAME=value`.
    pub name: &'static str,
    /// What it does, and its unit.
    pub summary: &'static str,
    /// Allowed numbers, both ends included; for other kinds of value the allowed words stand in `summary`.
    pub range: Option<(f64, f64)>,
}

/// A setting that cannot be set so.
#[derive(Debug, Clone, thiserror::Error, PartialEq, Eq)]
pub enum SettingError {
    /// No such setting.
    #[error("there is no setting {name:?}; there are: {known}")]
    Unknown {
        /// The name asked for.
        name: String,
        /// The names there are.
        known: String,
    },
    /// The value does not fit.
    #[error("{name}={value}: {reason}")]
    Value {
        /// Setting.
        name: String,
        /// Text given.
        value: String,
        /// Why not.
        reason: String,
    },
}

/// The settings as JSON.
pub fn to_json<S: Serialize>(settings: &S) -> serde_json::Value {
    serde_json::to_value(settings).unwrap_or_default()
}

/// Sets the field `name` of `settings` from `text`.
///
/// # Errors
/// [`SettingError`].
pub fn set<S: Serialize + DeserializeOwned>(
    settings: &mut S,
    fields: &[Field],
    name: &str,
    text: &str,
) -> Result<(), SettingError> {
    let field = fields
        .iter()
        .find(|field| field.name == name)
        .ok_or_else(|| SettingError::Unknown {
            name: name.to_owned(),
            known: fields
                .iter()
                .map(|field| field.name)
                .collect::<Vec<_>>()
                .join(", "),
        })?;
    let fail = |reason: String| SettingError::Value {
        name: name.to_owned(),
        value: text.to_owned(),
        reason,
    };
    let mut all = to_json(settings);
    // A number, true or false as JSON has them; anything else is a word, and so is what takes the place of one.
    let value: serde_json::Value = match serde_json::from_str(text) {
        Ok(value) if !all[name].is_string() => value,
        _ => text.into(),
    };
    if let Some((low, high)) = field.range {
        let number = value
            .as_f64()
            .ok_or_else(|| fail("a number is needed".into()))?;
        if !(low..=high).contains(&number) {
            return Err(fail(format!("the range is {low} to {high}")));
        }
    }
    all[name] = value;
    *settings = serde_json::from_value(all).map_err(|error| fail(error.to_string()))?;
    Ok(())
}

/// As [`set`], of settings some of which are the `sides` of maps with levels: powers of two. What is refused is not kept.
///
/// # Errors
/// [`SettingError`].
pub fn set_with_sides<S: Serialize + DeserializeOwned + Clone, const N: usize>(
    settings: &mut S,
    fields: &[Field],
    name: &str,
    text: &str,
    sides: impl Fn(&S) -> [u32; N],
) -> Result<(), SettingError> {
    let mut changed = settings.clone();
    set(&mut changed, fields, name, text)?;
    if !sides(&changed).iter().all(|side| side.is_power_of_two()) {
        return Err(SettingError::Value {
            name: name.to_owned(),
            value: text.to_owned(),
            reason: "a power of two is needed".into(),
        });
    }
    *settings = changed;
    Ok(())
}
