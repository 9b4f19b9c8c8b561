//! One setting of a technique: its name, what it does, and what it takes.

use std::borrow::Cow;
use std::fmt;

use serde::{Deserialize, Serialize};

use crate::fault::Fault;

/// A setting that a technique offers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Setting {
    /// Name in requests and on the command line.
    pub id: &'static str,
    /// Name for people.
    pub label: &'static str,
    /// What a larger value or each choice buys, and what it costs.
    pub help: &'static str,
    /// Unit of a number; empty without one.
    pub unit: &'static str,
    /// What it takes.
    #[serde(flatten)]
    pub kind: SettingKind,
}

/// What a setting takes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum SettingKind {
    /// A number within a range, ends included.
    Number {
        /// Value where none is given.
        default: f64,
        /// Smallest and largest value.
        range: [f64; 2],
        /// Whether only whole numbers are accepted.
        is_integer: bool,
    },
    /// On or off.
    Switch {
        /// Value where none is given.
        default: bool,
    },
    /// One of several names.
    Choice {
        /// Value where none is given; one of the names.
        default: &'static str,
        /// All names.
        names: &'static [&'static str],
    },
}

/// Value of a setting.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum SettingValue {
    /// Of a [`SettingKind::Switch`].
    Switch(bool),
    /// Of a [`SettingKind::Number`].
    Number(f64),
    /// Of a [`SettingKind::Choice`].
    Choice(Cow<'static, str>),
}

impl SettingValue {
    /// A name, for tables of constants.
    pub const fn name(name: &'static str) -> Self {
        Self::Choice(Cow::Borrowed(name))
    }
}

impl From<SettingValue> for serde_json::Value {
    fn from(value: SettingValue) -> Self {
        match value {
            SettingValue::Switch(is_on) => is_on.into(),
            SettingValue::Number(number) => number.into(),
            SettingValue::Choice(name) => name.into_owned().into(),
        }
    }
}

impl fmt::Display for SettingValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Switch(is_on) => f.write_str(if *is_on { "on" } else { "off" }),
            Self::Number(number) => number.fmt(f),
            Self::Choice(name) => f.write_str(name),
        }
    }
}

impl Setting {
    /// Value where none is given.
    pub const fn default_value(&self) -> SettingValue {
        match self.kind {
            SettingKind::Number { default, .. } => SettingValue::Number(default),
            SettingKind::Switch { default } => SettingValue::Switch(default),
            SettingKind::Choice { default, .. } => SettingValue::name(default),
        }
    }

    /// Reads a value as people type it.
    pub fn parse(&self, text: &str) -> Result<SettingValue, Fault> {
        let text = text.trim();
        match self.kind {
            SettingKind::Number { .. } => match text.parse() {
                Ok(number) => self.check(&SettingValue::Number(number)),
                Err(_) => Err(self.refused()),
            },
            SettingKind::Switch { .. } => match text {
                "on" | "true" | "1" => Ok(SettingValue::Switch(true)),
                "off" | "false" | "0" => Ok(SettingValue::Switch(false)),
                _ => Err(self.refused()),
            },
            SettingKind::Choice { .. } => self.check(&SettingValue::Choice(text.to_owned().into())),
        }
    }

    /// Reads a value of a request. A switch also takes 0 and 1.
    pub fn read(&self, json: &serde_json::Value) -> Result<SettingValue, Fault> {
        let malformed = |expected: &str| Fault::malformed(self.id, format!("expected {expected}"));
        match self.kind {
            SettingKind::Number { .. } => {
                let number = json.as_f64().ok_or_else(|| malformed("a number"))?;
                self.check(&SettingValue::Number(number))
            }
            SettingKind::Switch { .. } => match (json.as_bool(), json.as_f64()) {
                (Some(is_on), _) => Ok(SettingValue::Switch(is_on)),
                (None, Some(number)) if number == 0.0 || number == 1.0 => Ok(SettingValue::Switch(number == 1.0)),
                (None, Some(_)) => Err(self.refused()),
                (None, None) => Err(malformed("true or false")),
            },
            SettingKind::Choice { .. } => {
                let name = json.as_str().ok_or_else(|| malformed("a string"))?;
                self.check(&SettingValue::Choice(name.to_owned().into()))
            }
        }
    }

    /// A value that the setting takes, or why it does not.
    pub fn check(&self, value: &SettingValue) -> Result<SettingValue, Fault> {
        let is_taken = match (self.kind, value) {
            (SettingKind::Number { range: [least, most], is_integer, .. }, SettingValue::Number(number)) => {
                // Written so that NaN is refused.
                *number >= least && *number <= most && (!is_integer || number.fract() == 0.0)
            }
            (SettingKind::Switch { .. }, SettingValue::Switch(_)) => true,
            (SettingKind::Choice { names, .. }, SettingValue::Choice(name)) => names.contains(&name.as_ref()),
            _ => false,
        };
        if is_taken { Ok(value.clone()) } else { Err(self.refused()) }
    }

    /// What it takes, in words.
    pub fn accepted(&self) -> String {
        match self.kind {
            SettingKind::Number { range: [least, most], is_integer: false, .. } => {
                format!("within {least} to {most}")
            }
            SettingKind::Number { range: [least, most], .. } => format!("a whole number within {least} to {most}"),
            SettingKind::Switch { .. } => "on or off (true or false)".to_owned(),
            SettingKind::Choice { names, .. } => format!("one of {}", names.join(", ")),
        }
    }

    fn refused(&self) -> Fault {
        Fault::value(self.id, format!("must be {}", self.accepted()))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use serde_json::json;

    use super::*;

    pub(crate) const RADIUS: Setting = Setting {
        id: "radius",
        label: "Radius",
        help: "smaller shows more detail",
        unit: "pixels",
        kind: SettingKind::Number { default: 5.0, range: [1.5, 32.0], is_integer: false },
    };
    pub(crate) const CAPACITY: Setting = Setting {
        id: "capacity",
        label: "Capacity",
        help: "more keep more",
        unit: "",
        kind: SettingKind::Number { default: 0.0, range: [0.0, 4.0], is_integer: true },
    };
    pub(crate) const DEPTH: Setting = Setting {
        id: "depth",
        label: "Depth",
        help: "respects walls",
        unit: "",
        kind: SettingKind::Switch { default: true },
    };
    pub(crate) const GRID: Setting = Setting {
        id: "grid",
        label: "Grid",
        help: "how things are found",
        unit: "",
        kind: SettingKind::Choice { default: "cascades", names: &["cascades", "trapezoidal"] },
    };

    #[test]
    fn what_people_type_is_checked_by_kind() {
        for (setting, text, value) in [
            (RADIUS, "1.5", SettingValue::Number(1.5)),
            (RADIUS, " 32 ", SettingValue::Number(32.0)),
            (CAPACITY, "4", SettingValue::Number(4.0)),
            (DEPTH, "off", SettingValue::Switch(false)),
            (DEPTH, "1", SettingValue::Switch(true)),
            (GRID, "trapezoidal", SettingValue::name("trapezoidal")),
        ] {
            assert_eq!(setting.parse(text), Ok(value), "{}={text}", setting.id);
        }
        for (setting, text, accepted) in [
            (RADIUS, "1.4", "1.5 to 32"),
            (RADIUS, "nan", "1.5 to 32"),
            (RADIUS, "", "1.5 to 32"),
            (CAPACITY, "1.5", "a whole number"),
            (DEPTH, "2", "on or off"),
            (GRID, "1", "cascades, trapezoidal"),
        ] {
            let fault = setting.parse(text).expect_err(text);
            assert_eq!((fault.field.as_str(), fault.is_malformed), (setting.id, false));
            assert!(fault.reason.contains(accepted), "{fault}");
        }
    }

    #[test]
    fn values_of_another_type_are_malformed_and_values_out_of_range_are_not() {
        assert_eq!(DEPTH.read(&json!(0)), Ok(SettingValue::Switch(false)), "switches were numbers once");
        for (setting, value, is_malformed) in [
            (RADIUS, json!("4"), true),
            (RADIUS, json!(true), true),
            (RADIUS, json!(1e300), false),
            (DEPTH, json!("on"), true),
            (DEPTH, json!(0.5), false),
            (GRID, json!(1), true),
            (GRID, json!("hashed"), false),
        ] {
            let fault = setting.read(&value).expect_err(setting.id);
            assert_eq!((fault.field.as_str(), fault.is_malformed), (setting.id, is_malformed), "{value}: {fault}");
        }
    }
}
