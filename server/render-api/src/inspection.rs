//! Why a point is as bright as it is, as a technique explains it: figures of the point, and rows behind them.

use serde::Serialize;

/// What a technique knows of the surface under a point of the image.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
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
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Field {
    /// Machine-readable name.
    pub id: &'static str,
    /// Name for people.
    pub label: &'static str,
    /// Unit; empty without one.
    pub unit: &'static str,
    /// The figure.
    pub value: Value,
}

/// What the values of a column mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Column {
    /// Machine-readable name.
    pub id: &'static str,
    /// Name for people.
    pub label: &'static str,
    /// Unit; empty without one. `share` is a number in [0, 1] that is shown as percent, `count` and `id` are whole.
    pub unit: &'static str,
}

/// One contribution.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Row {
    /// One value a column.
    pub values: Vec<Value>,
    /// Where it lies, to be drawn into the image.
    pub disc: Option<Disc>,
}

/// A disc in the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Disc {
    /// Centre, world space, metres.
    pub position: [f64; 3],
    /// World space.
    pub normal: [f32; 3],
    /// Metres.
    pub radius: f32,
}

/// A number, or three of them: a colour or a vector.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Value {
    /// One number.
    Number(f32),
    /// A whole number, such as an id.
    Count(u32),
    /// Three numbers.
    Triple([f32; 3]),
}

impl Default for Value {
    fn default() -> Self {
        Self::Number(0.0)
    }
}
