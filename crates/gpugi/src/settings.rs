//! Typed settings, stated once. One declaration gives the struct with its defaults, setting by name from text or JSON,
//! ranges, help, and tables.
//!
//! ```
//! gpugi::settings! {
//!     /// Settings of a technique.
//!     pub struct Settings {
//!         /// Side of its map.
//!         pub resolution: u32 = 256 => in_range(16.0, 1024.0).power_of_two().unit("texels"),
//!         /// Whether it is blurred.
//!         pub blurred: bool = true => any(),
//!     }
//! }
//! use gpugi::settings::SettingSet;
//!
//! let mut settings = Settings::default();
//! settings.set("resolution", "512")?;
//! assert_eq!(settings.resolution, 512);
//! # Ok::<(), gpugi::settings::SettingError>(())
//! ```

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

#[doc(hidden)]
pub use {serde, serde_json, std::sync::LazyLock};

/// What kind of value a setting holds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "kind", content = "words")]
pub enum Kind {
    /// A whole number.
    Integer,
    /// A number.
    Number,
    /// True or false.
    Flag,
    /// One of these words.
    Choice(&'static [&'static str]),
    /// A number, or this word.
    NumberOr(&'static str),
    /// Text; the help says what it means.
    Text,
}

/// A type that settings can have.
pub trait SettingValue: Serialize + DeserializeOwned {
    /// Its kind.
    const KIND: Kind;
}

macro_rules! setting_values {
    ($($kind:ident: $($type:ty),+;)+) => { $($(
        impl SettingValue for $type {
            const KIND: Kind = Kind::$kind;
        }
    )+)+ };
}

setting_values! {
    Integer: u32;
    Number: f32, f64;
    Flag: bool;
    Text: String;
}

/// Limits on a setting's values beyond its type, and their unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Constraint {
    range: Option<(f64, f64)>,
    unit: &'static str,
    is_power_of_two: bool,
}

/// Any value of the type.
pub const fn any() -> Constraint {
    Constraint {
        range: None,
        unit: "",
        is_power_of_two: false,
    }
}

/// Numbers from `low` to `high`, both included.
pub const fn in_range(low: f64, high: f64) -> Constraint {
    Constraint {
        range: Some((low, high)),
        ..any()
    }
}

impl Constraint {
    /// Powers of two only.
    pub const fn power_of_two(self) -> Self {
        Self {
            is_power_of_two: true,
            ..self
        }
    }

    /// The values' unit, such as `m` or `texels`.
    pub const fn unit(self, unit: &'static str) -> Self {
        Self { unit, ..self }
    }
}

/// Description of one setting, for tables and sliders.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Field {
    /// Name in `--set technique.NAME=value`.
    pub name: String,
    /// What it does: one line.
    pub help: String,
    /// Kind of its value.
    #[serde(flatten)]
    pub kind: Kind,
    /// Smallest and largest number, both allowed.
    pub range: Option<(f64, f64)>,
    /// Unit of the number; empty without one.
    pub unit: &'static str,
    /// Whether only powers of two are allowed.
    pub is_power_of_two: bool,
    /// The default value.
    pub default: Value,
}

impl Field {
    #[doc(hidden)]
    pub fn new(
        identifier: &str,
        help: &[&str],
        kind: Kind,
        constraint: Constraint,
        defaults: &Value,
    ) -> Self {
        let name = kebab(identifier);
        let help: Vec<&str> = help.iter().map(|line| line.trim()).collect();
        Self {
            default: defaults[&name].clone(),
            name,
            help: help.join(" ").trim_end_matches('.').to_owned(),
            kind,
            range: constraint.range,
            unit: constraint.unit,
            is_power_of_two: constraint.is_power_of_two,
        }
    }

    /// The allowed values in words: `16 to 1024, powers of two`.
    pub fn values(&self) -> String {
        let mut text = match (self.kind, self.range) {
            (_, Some((low, high))) => format!("{low} to {high}"),
            (Kind::Flag, None) => "true, false".to_owned(),
            (Kind::Choice(words), None) => words.join(", "),
            (Kind::NumberOr(word), None) => format!("{word}, or a number"),
            (Kind::Integer | Kind::Number | Kind::Text, None) => String::new(),
        };
        if self.is_power_of_two {
            text.push_str(", powers of two");
        }
        text
    }

    /// Turns text into a value of this setting.
    fn parse(&self, text: &str) -> Result<Value, String> {
        let value = match self.kind {
            Kind::NumberOr(_) | Kind::Text => return Ok(text.into()),
            Kind::Choice(words) if words.contains(&text) => return Ok(text.into()),
            Kind::Choice(words) => return Err(format!("the choices are {}", words.join(", "))),
            Kind::Flag => {
                return text
                    .parse::<bool>()
                    .map(Value::from)
                    .map_err(|_| "true or false is needed".into());
            }
            Kind::Integer => match text.parse::<u32>() {
                Ok(number) => Value::from(number),
                Err(_) if text.parse::<f64>().is_ok_and(|number| !self.holds(number)) => {
                    return Err(self.range_error());
                }
                Err(_) => return Err("a whole number is needed".into()),
            },
            Kind::Number => match text.parse::<f64>() {
                Ok(number) if number.is_finite() => Value::from(number),
                _ => return Err("a number is needed".into()),
            },
        };
        self.check(&value).map(|()| value)
    }

    fn holds(&self, number: f64) -> bool {
        self.range
            .is_none_or(|(low, high)| (low..=high).contains(&number))
    }

    fn range_error(&self) -> String {
        let (low, high) = self.range.unwrap_or_default();
        format!("the range is {low} to {high}")
    }

    /// Whether a value that the type can hold is allowed.
    fn check(&self, value: &Value) -> Result<(), String> {
        // JSON writes a non-finite number as null.
        let is_allowed =
            self.range.is_none() || value.as_f64().is_some_and(|number| self.holds(number));
        if !is_allowed {
            return Err(self.range_error());
        }
        if self.is_power_of_two && !value.as_u64().is_some_and(u64::is_power_of_two) {
            return Err("a power of two is needed".into());
        }
        Ok(())
    }
}

/// `filter_radius` as `filter-radius`.
pub fn kebab(identifier: &str) -> String {
    identifier.replace('_', "-")
}

/// Why a setting cannot be set.
#[derive(Debug, Clone, thiserror::Error, PartialEq, Eq)]
pub enum SettingError {
    /// No such setting.
    #[error("there is no setting {name:?}; there are: {known}")]
    Unknown {
        /// The requested name.
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
        /// The reason.
        reason: String,
    },
}

/// Settings that people and programs set by name. [`settings!`](crate::settings!) implements it.
pub trait SettingSet {
    /// What can be set, in order of declaration.
    fn fields(&self) -> &'static [Field];

    /// All values, by name.
    fn to_json(&self) -> Value;

    /// Replaces all values by those of an object in the form of `to_json`.
    ///
    /// # Errors
    /// Why a value does not fit its type.
    fn replace(&mut self, values: Value) -> Result<(), String>;

    /// Sets one value from text.
    ///
    /// # Errors
    /// [`SettingError`]; then nothing has changed.
    fn set(&mut self, name: &str, text: &str) -> Result<(), SettingError> {
        let fields = self.fields();
        let field = fields
            .iter()
            .find(|field| field.name == name)
            .ok_or_else(|| {
                let known: Vec<&str> = fields.iter().map(|field| field.name.as_str()).collect();
                SettingError::Unknown {
                    name: name.to_owned(),
                    known: known.join(", "),
                }
            })?;
        let set = field.parse(text).and_then(|value| {
            let mut all = self.to_json();
            all[name] = value;
            self.replace(all)
        });
        set.map_err(|reason| SettingError::Value {
            name: name.to_owned(),
            value: text.to_owned(),
            reason,
        })
    }

    /// Sets the values that a JSON object names; the others stay.
    ///
    /// # Errors
    /// [`SettingError`]; then nothing has changed.
    fn set_json(&mut self, values: &serde_json::Map<String, Value>) -> Result<(), SettingError> {
        let before = self.to_json();
        for (name, value) in values {
            let text = value
                .as_str()
                .map_or_else(|| value.to_string(), str::to_owned);
            if let Err(error) = self.set(name, &text) {
                // The former values are valid.
                let _ = self.replace(before);
                return Err(error);
            }
        }
        Ok(())
    }

    /// Checks that every value is in range, for settings that code filled in.
    ///
    /// # Errors
    /// [`SettingError::Value`].
    fn check(&self) -> Result<(), SettingError> {
        let all = self.to_json();
        for field in self.fields() {
            field
                .check(&all[&field.name])
                .map_err(|reason| SettingError::Value {
                    name: field.name.clone(),
                    value: all[&field.name].to_string(),
                    reason,
                })?;
        }
        Ok(())
    }
}

/// Declares a struct of settings: each field with its help (the doc comment), its default and its allowed values. See
/// [`mod@crate::settings`].
#[macro_export]
macro_rules! settings {
    (
        $(#[$of_struct:meta])*
        pub struct $name:ident {
            $(
                $(#[doc = $help:literal])+
                pub $field:ident: $type:ty = $default:expr => $constraint:expr
            ),+ $(,)?
        }
    ) => {
        $(#[$of_struct])*
        #[derive(Debug, Clone, PartialEq, $crate::settings::serde::Serialize, $crate::settings::serde::Deserialize)]
        #[serde(crate = "gpugi::settings::serde", deny_unknown_fields, rename_all = "kebab-case")]
        pub struct $name {
            $(
                $(#[doc = $help])+
                pub $field: $type,
            )+
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $($field: $default,)+ }
            }
        }

        impl $name {
            /// What can be set, in order of declaration.
            pub fn fields() -> &'static [$crate::settings::Field] {
                static FIELDS: $crate::settings::LazyLock<Vec<$crate::settings::Field>> =
                    $crate::settings::LazyLock::new(|| {
                        #[allow(unused_imports)]
                        use $crate::settings::{any, in_range};
                        let defaults = $crate::settings::SettingSet::to_json(&$name::default());
                        vec![$(
                            $crate::settings::Field::new(
                                stringify!($field),
                                &[$($help),+],
                                <$type as $crate::settings::SettingValue>::KIND,
                                $constraint,
                                &defaults,
                            ),
                        )+]
                    });
                &FIELDS
            }
        }

        impl $crate::settings::SettingSet for $name {
            fn fields(&self) -> &'static [$crate::settings::Field] {
                Self::fields()
            }

            fn to_json(&self) -> $crate::settings::serde_json::Value {
                $crate::settings::serde_json::to_value(self).unwrap_or_default()
            }

            fn replace(&mut self, values: $crate::settings::serde_json::Value) -> Result<(), String> {
                *self = $crate::settings::serde_json::from_value(values).map_err(|error| error.to_string())?;
                Ok(())
            }
        }
    };
}

/// Declares an enumeration whose words are the values of a setting.
#[macro_export]
macro_rules! choices {
    (
        $(#[$of_enum:meta])*
        pub enum $name:ident {
            $( $(#[$of_variant:meta])* $variant:ident = $word:literal ),+ $(,)?
        }
    ) => {
        $(#[$of_enum])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, $crate::settings::serde::Serialize, $crate::settings::serde::Deserialize)]
        #[serde(crate = "gpugi::settings::serde")]
        pub enum $name {
            $( $(#[$of_variant])* #[serde(rename = $word)] $variant ),+
        }

        impl $crate::settings::SettingValue for $name {
            const KIND: $crate::settings::Kind = $crate::settings::Kind::Choice(&[$($word),+]);
        }
    };
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::techniques::Registry;

    crate::choices! {
        /// A choice.
        pub enum Color {
            /// Red.
            Red = "red",
            /// Blue.
            DarkBlue = "dark-blue",
        }
    }

    crate::settings! {
        /// Some of each kind.
        pub struct Sample {
            /// Side of a map.
            pub side: u32 = 64 => in_range(16.0, 256.0).power_of_two().unit("texels"),
            /// How strong,
            /// in two lines.
            pub strength: f32 = 0.5 => in_range(0.0, 1.0),
            /// Whether.
            pub is_on: bool = true => any(),
            /// Which.
            pub color: Color = Color::Red => any(),
            /// Who.
            pub names: String = "all".to_owned() => any(),
        }
    }

    #[test]
    fn one_declaration_says_all() {
        let fields = Sample::fields();
        let names: Vec<&str> = fields.iter().map(|field| field.name.as_str()).collect();
        assert_eq!(names, ["side", "strength", "is-on", "color", "names"]);
        let values: Vec<String> = fields.iter().map(Field::values).collect();
        assert_eq!(
            values,
            [
                "16 to 256, powers of two",
                "0 to 1",
                "true, false",
                "red, dark-blue",
                ""
            ]
        );
        assert_eq!(fields[1].help, "How strong, in two lines");
        assert_eq!((fields[0].unit, &fields[0].default), ("texels", &64.into()));
        assert_eq!(fields[3].default, "red");
    }

    #[test]
    fn values_are_set_from_text_and_json_or_refused_whole() {
        let mut sample = Sample::default();
        for (name, value) in [
            ("side", "128"),
            ("strength", "0.25"),
            ("is-on", "false"),
            ("color", "dark-blue"),
            ("names", "12"),
        ] {
            sample.set(name, value).unwrap();
        }
        let expected = Sample {
            side: 128,
            strength: 0.25,
            is_on: false,
            color: Color::DarkBlue,
            names: "12".into(),
        };
        assert_eq!(sample, expected);
        for (name, value, reason) in [
            ("side", "8", "the range is 16 to 256"),
            ("side", "-1", "the range is 16 to 256"),
            ("side", "100", "a power of two is needed"),
            ("side", "64.5", "a whole number is needed"),
            ("strength", "2", "the range is 0 to 1"),
            ("strength", "nan", "a number is needed"),
            ("strength", "much", "a number is needed"),
            ("is-on", "yes", "true or false is needed"),
            ("color", "green", "the choices are red, dark-blue"),
            (
                "size",
                "1",
                "there are: side, strength, is-on, color, names",
            ),
        ] {
            let error = sample.set(name, value).unwrap_err().to_string();
            assert!(error.contains(reason), "{name}={value}: {error}");
        }
        let json: Value = serde_json::json!({ "strength": 0.75, "side": 7 });
        assert!(sample.set_json(json.as_object().unwrap()).is_err());
        assert_eq!(sample, expected);
        let json: Value = serde_json::json!({ "strength": 0.75, "color": "red" });
        sample.set_json(json.as_object().unwrap()).unwrap();
        assert_eq!(
            (sample.strength, sample.color, sample.side),
            (0.75, Color::Red, 128)
        );
    }

    #[test]
    fn defaults_of_all_techniques_are_allowed_and_explained() {
        for technique in Registry::default().all() {
            for field in (technique.fields)() {
                let context = format!("{}.{}", technique.info.name, field.name);
                field
                    .check(&field.default)
                    .unwrap_or_else(|error| panic!("{context}: {error}"));
                assert!(
                    field.help.len() > 10 && !field.help.ends_with('.'),
                    "{context}: {}",
                    field.help
                );
            }
        }
    }
}
