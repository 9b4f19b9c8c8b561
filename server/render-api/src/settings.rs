//! Values of settings by id: what a technique is handed, and reads by its own descriptors.

use std::borrow::Cow;
use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::fault::Fault;
use crate::setting::{Setting, SettingKind, SettingValue};

/// Values by id. An id that is missing stands for the setting's default.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Settings(BTreeMap<Cow<'static, str>, SettingValue>);

impl Settings {
    /// Every setting at its default.
    pub fn defaults(of: &[Setting]) -> Self {
        of.iter().map(|setting| (setting.id, setting.default_value())).collect()
    }

    /// Sets a value that the setting takes, or says why it does not.
    pub fn set(&mut self, setting: &Setting, value: &SettingValue) -> Result<(), Fault> {
        let value = setting.check(value)?;
        self.0.insert(Cow::Borrowed(setting.id), value);
        Ok(())
    }

    /// Sets `name=value` as people type it. A fault names the setting and what it takes, or the settings there are.
    pub fn set_text(&mut self, of: &[Setting], assignment: &str) -> Result<(), Fault> {
        let Some((id, text)) = assignment.split_once('=') else {
            return Err(Fault::malformed(assignment, format!("expected NAME=VALUE; {}", known(of))));
        };
        let setting = find(of, id.trim())?;
        let value = setting.parse(text)?;
        self.0.insert(Cow::Borrowed(setting.id), value);
        Ok(())
    }

    /// Sets a value of a request.
    pub fn set_json(&mut self, of: &[Setting], id: &str, json: &serde_json::Value) -> Result<(), Fault> {
        let setting = find(of, id)?;
        let value = setting.read(json)?;
        self.0.insert(Cow::Borrowed(setting.id), value);
        Ok(())
    }

    /// The same with values of `over` where it has any.
    #[must_use]
    pub fn with(mut self, over: &Self) -> Self {
        self.0.extend(over.0.clone());
        self
    }

    /// Value of a setting.
    pub fn get(&self, setting: &Setting) -> SettingValue {
        self.0.get(setting.id).cloned().unwrap_or_else(|| setting.default_value())
    }

    /// Value of a number; 0 for a setting of another kind.
    pub fn number(&self, setting: &Setting) -> f64 {
        if let SettingValue::Number(number) = self.get(setting) { number } else { 0.0 }
    }

    /// Value of a switch; off for a setting of another kind.
    pub fn switch(&self, setting: &Setting) -> bool {
        self.get(setting) == SettingValue::Switch(true)
    }

    /// Index of the chosen name among the setting's; the first for a setting of another kind.
    pub fn choice(&self, setting: &Setting) -> usize {
        let SettingKind::Choice { names, .. } = setting.kind else { return 0 };
        let SettingValue::Choice(name) = self.get(setting) else { return 0 };
        names.iter().position(|known| *known == name).unwrap_or(0)
    }

    /// All values by id.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &SettingValue)> {
        self.0.iter().map(|(id, value)| (id.as_ref(), value))
    }
}

impl FromIterator<(&'static str, SettingValue)> for Settings {
    fn from_iter<I: IntoIterator<Item = (&'static str, SettingValue)>>(values: I) -> Self {
        Self(values.into_iter().map(|(id, value)| (Cow::Borrowed(id), value)).collect())
    }
}

fn find<'a>(of: &'a [Setting], id: &str) -> Result<&'a Setting, Fault> {
    of.iter().find(|setting| setting.id == id).ok_or_else(|| {
        let shown: String = id.chars().take(64).collect();
        Fault::value(shown, format!("no such setting; {}", known(of)))
    })
}

fn known(of: &[Setting]) -> String {
    let ids: Vec<&str> = of.iter().map(|setting| setting.id).collect();
    if ids.is_empty() { "there are none".to_owned() } else { format!("there are {}", ids.join(", ")) }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::setting::tests::{CAPACITY, DEPTH, GRID, RADIUS};

    const ALL: &[Setting] = &[RADIUS, CAPACITY, DEPTH, GRID];

    #[test]
    fn values_are_set_by_name_and_refused_by_name() {
        let mut settings = Settings::defaults(ALL);
        let before = settings.clone();
        for bad in ["radius", "radius=", "radius=nan", "size=3", "=", "radius=-1", "grid=1"] {
            let fault = settings.set_text(ALL, bad).expect_err(bad);
            assert!(fault.reason.contains("radius") || fault.reason.contains("must be"), "{fault}");
        }
        assert_eq!(settings, before);
        for good in ["radius=3", "capacity=2", "depth=off", "grid=trapezoidal"] {
            settings.set_text(ALL, good).expect(good);
        }
        assert_eq!((settings.number(&RADIUS), settings.number(&CAPACITY)), (3.0, 2.0));
        assert_eq!((settings.switch(&DEPTH), settings.choice(&GRID)), (false, 1));
        settings.set_json(ALL, "depth", &json!(true)).expect("a switch");
        assert!(settings.switch(&DEPTH));
        assert!(settings.set_json(ALL, "size", &json!(1)).is_err_and(|fault| !fault.is_malformed));
    }

    #[test]
    fn what_is_not_given_is_the_default() {
        let sparse: Settings = [(RADIUS.id, SettingValue::Number(2.0))].into_iter().collect();
        assert_eq!((sparse.number(&RADIUS), sparse.switch(&DEPTH), sparse.choice(&GRID)), (2.0, true, 0));
        let whole = Settings::defaults(ALL).with(&sparse);
        assert_eq!((whole.iter().count(), whole.number(&RADIUS)), (ALL.len(), 2.0));
        let json = serde_json::to_value(&whole).expect("encodes");
        assert_eq!(json, json!({"radius": 2.0, "capacity": 0.0, "depth": true, "grid": "cascades"}));
        assert_eq!(serde_json::from_value::<Settings>(json).expect("decodes"), whole);
    }
}
