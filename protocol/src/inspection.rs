//! Why a point is as bright as it is, as a technique explains it: figures of the point, and rows behind them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What a technique knows of the surface under a point of the image.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Inspection {
    /// World space, metres.
    pub position: [f64; 3],
    /// World space, towards the viewer.
    pub normal: [f32; 3],
    /// What was found, in one sentence.
    pub headline: String,
    /// Figures of the point.
    pub summary: Vec<Field>,
    /// What the rows' values mean.
    pub columns: Vec<Column>,
    /// What is behind the figures, the most important first.
    pub rows: Vec<Row>,
}

/// A figure by name.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Field {
    /// Machine-readable name.
    pub id: String,
    /// Name for people.
    pub label: String,
    /// Unit; empty without one.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub unit: String,
    /// The figure.
    pub value: FieldValue,
}

/// What the values of a column mean.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Column {
    /// Machine-readable name.
    pub id: String,
    /// Name for people.
    pub label: String,
    /// Unit; empty without one. `share`: a number in [0, 1], to be shown as percent; `count`: a whole number.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub unit: String,
}

/// One contribution.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Row {
    /// One value a column.
    pub values: Vec<FieldValue>,
    /// Where it lies, to be drawn into the image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub disc: Option<Disc>,
}

/// A disc in the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Disc {
    /// Centre, world space, metres.
    pub position: [f64; 3],
    /// World space.
    pub normal: [f32; 3],
    /// Metres.
    pub radius: f32,
}

/// A number, or three of them: a colour or a vector.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum FieldValue {
    /// A whole number, such as an id.
    Count(u32),
    /// One number.
    Number(f32),
    /// Three numbers.
    Triple([f32; 3]),
}

impl Default for FieldValue {
    fn default() -> Self {
        Self::Number(0.0)
    }
}

impl FieldValue {
    fn is_finite(self) -> bool {
        match self {
            Self::Count(_) => true,
            Self::Number(number) => number.is_finite(),
            Self::Triple(numbers) => numbers.iter().all(|number| number.is_finite()),
        }
    }
}

impl Inspection {
    /// Name of the first value that is not finite: JSON cannot state it, so such an inspection cannot be sent.
    pub fn not_finite(&self) -> Option<String> {
        let is_place = |position: &[f64; 3], normal: &[f32; 3]| {
            position.iter().all(|value| value.is_finite()) && normal.iter().all(|value| value.is_finite())
        };
        if !is_place(&self.position, &self.normal) {
            return Some("position".to_owned());
        }
        if let Some(field) = self.summary.iter().find(|field| !field.value.is_finite()) {
            return Some(field.id.clone());
        }
        self.rows.iter().enumerate().find_map(|(index, row)| {
            let disc = row.disc.filter(|disc| !is_place(&disc.position, &disc.normal) || !disc.radius.is_finite());
            let column = row.values.iter().position(|value| !value.is_finite());
            let name = match (disc, column) {
                (None, None) => return None,
                (_, Some(column)) => self.columns.get(column).map_or("a value", |column| column.id.as_str()),
                (Some(_), None) => "disc",
            };
            Some(format!("{name} of row {index}"))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_json_cannot_say_is_found_by_name() {
        let column = |id: &str| Column { id: id.to_owned(), ..Column::default() };
        let row = |number: f32, radius: f32| Row {
            values: vec![FieldValue::Count(7), FieldValue::Number(number)],
            disc: Some(Disc { radius, ..Disc::default() }),
        };
        let good = Inspection {
            columns: vec![column("id"), column("std_error")],
            rows: vec![row(0.5, 1.0)],
            ..Inspection::default()
        };
        assert_eq!(good.not_finite(), None);
        let light =
            Field { id: "direct".to_owned(), value: FieldValue::Triple([0.0, f32::NAN, 0.0]), ..Field::default() };
        let own = Inspection { summary: vec![light], ..good.clone() };
        assert_eq!(own.not_finite().as_deref(), Some("direct"));
        let of_a_row = Inspection { rows: vec![row(0.5, 1.0), row(f32::INFINITY, 1.0)], ..good.clone() };
        assert_eq!(of_a_row.not_finite().as_deref(), Some("std_error of row 1"));
        let of_a_disc = Inspection { rows: vec![row(0.5, f32::NAN)], ..good };
        assert_eq!(of_a_disc.not_finite().as_deref(), Some("disc of row 0"));
    }

    #[test]
    fn whole_numbers_stay_whole() {
        let values = [
            FieldValue::Count(4711),
            FieldValue::Number(0.5),
            FieldValue::Number(256.0),
            FieldValue::Triple([0.5, 1.0, 2.0]),
        ];
        let text = serde_json::to_string(&values).expect("encodes");
        assert_eq!(text, "[4711,0.5,256.0,[0.5,1.0,2.0]]");
        assert_eq!(serde_json::from_str::<Vec<FieldValue>>(&text).expect("decodes"), values);
    }
}
