//! Settings of the surfel cache in a render's body: a preset, and single knobs turned from there.

use serde_json::Value;
use surfelcast_renderer::{KNOBS, Knob, Reconstruction, SurfelSettings};
use surfelcast_review::number::within;
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{AdditionalProperties, Object, ObjectBuilder, Schema, Type};
use utoipa::{Number, PartialSchema, ToSchema};

use crate::http::problem::ApiError;

/// Reads the fields `preset`, `reconstruction` and `surfel`. 400 for what is not well formed, 422 for values that cannot be.
pub(crate) fn surfel_settings(
    preset: Option<&str>,
    reconstruction: Option<&str>,
    knobs: Option<&Value>,
) -> Result<SurfelSettings, ApiError> {
    let mut settings = match preset {
        None => SurfelSettings::default(),
        Some(name) => SurfelSettings::by_name(name)
            .ok_or_else(|| ApiError::unprocessable(format!("preset: must be one of {}", preset_names().join(", "))))?,
    };
    if let Some(name) = reconstruction {
        settings.reconstruction = Reconstruction::by_name(name).ok_or_else(|| {
            let known = Reconstruction::names().join(", ");
            ApiError::unprocessable(format!("reconstruction: must be one of {known}"))
        })?;
    }
    let knobs = match knobs {
        None => return Ok(settings),
        Some(Value::Object(knobs)) => knobs,
        Some(_) => return Err(ApiError::bad_request("surfel: expected an object of knobs with numbers")),
    };
    for (name, value) in knobs.iter().filter(|(_, value)| !value.is_null()) {
        let Some(knob) = KNOBS.iter().find(|knob| knob.name == name) else {
            let name: String = name.chars().take(64).collect();
            let names: Vec<&str> = KNOBS.iter().map(|knob| knob.name).collect();
            return Err(ApiError::unprocessable(format!(
                "surfel.{name}: no such knob; there are {}",
                names.join(", ")
            )));
        };
        let field = format!("surfel.{name}");
        let number = value.as_f64().ok_or_else(|| ApiError::bad_request(format!("{field}: expected a number")))? as f32;
        let [least, most] = knob.range;
        within(&field, number, least, most).map_err(ApiError::unprocessable)?;
        let turned = settings.turn(&format!("{name}={number}"));
        turned.map_err(|why| ApiError::unprocessable(format!("{field}: {why}")))?;
    }
    Ok(settings)
}

fn preset_names() -> Vec<&'static str> {
    SurfelSettings::PRESETS.iter().map(|(name, _)| *name).collect()
}

/// Describes `preset`.
pub(crate) fn preset_schema() -> Object {
    let default = SurfelSettings::PRESETS.iter().find(|(_, preset)| *preset == SurfelSettings::default());
    ObjectBuilder::new()
        .schema_type(Type::String)
        .enum_values(Some(preset_names()))
        .default(default.map(|(name, _)| (*name).into()))
        .description(Some(
            "Settings of the surfel cache to start from. Only with a technique that has surfels: others refuse it.",
        ))
        .build()
}

/// Describes `reconstruction`.
pub(crate) fn reconstruction_schema() -> Object {
    ObjectBuilder::new()
        .schema_type(Type::String)
        .enum_values(Some(Reconstruction::names()))
        .default(Some(SurfelSettings::default().reconstruction.name().into()))
        .description(Some("How light is made of what surfels measured. Only with a technique that has surfels: others refuse all but none."))
        .build()
}

/// Describes `surfel`: every knob with its range, its default and what it does.
#[derive(Debug)]
pub(crate) struct SurfelKnobs;

impl PartialSchema for SurfelKnobs {
    fn schema() -> RefOr<Schema> {
        let with = |object: ObjectBuilder, knob: &Knob| object.property(knob.name, knob_schema(knob));
        KNOBS
            .iter()
            .fold(ObjectBuilder::new().schema_type(Type::Object), with)
            .additional_properties(Some(AdditionalProperties::<Schema>::FreeForm(false)))
            .description(Some("Knobs of the surfel cache, only with a technique that has surfels: others refuse them. Those left out are as in the preset; defaults are those of the default preset."))
            .into()
    }
}

impl ToSchema for SurfelKnobs {}

fn knob_schema(knob: &Knob) -> Object {
    let [least, most] = knob.range.map(decimal);
    ObjectBuilder::new()
        .schema_type(Type::Number)
        .minimum(Some(Number::Float(least)))
        .maximum(Some(Number::Float(most)))
        .default(Some(decimal(SurfelSettings::default().value_of(knob)).into()))
        .description(Some(knob.help))
        .build()
}

/// The number as people wrote it: 0.05 and not 0.05000000074505806.
fn decimal(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn knobs_turn_from_the_preset() {
        let settings = |preset, knobs: Value| surfel_settings(preset, None, Some(&knobs)).expect("valid");
        assert_eq!(surfel_settings(None, None, None).expect("valid"), SurfelSettings::BALANCED);
        for (name, preset) in SurfelSettings::PRESETS {
            assert_eq!(settings(Some(name), json!({})), preset);
            let turned = settings(Some(name), json!({"radius": 4, "rays": 1, "coverage": null}));
            assert_eq!(turned, SurfelSettings { radius_pixels: 4.0, rays_per_pixel: 1.0, ..preset });
        }
    }

    #[test]
    fn every_knob_takes_its_limits_and_nothing_beyond() {
        for knob in KNOBS {
            let [least, most] = knob.range.map(decimal);
            for value in [least, most] {
                let mut knobs = serde_json::Map::new();
                knobs.insert(knob.name.into(), json!(value));
                let settings = surfel_settings(None, None, Some(&Value::Object(knobs))).expect(knob.name);
                assert_eq!(settings.value_of(knob), value as f32, "{}", knob.name);
            }
            for value in [json!(least - 0.25), json!(most * 1.25), json!(-1e300), json!(1e300)] {
                let knobs = json!({ knob.name: value });
                let error = surfel_settings(None, None, Some(&knobs)).expect_err(knob.name);
                assert_eq!(error.status().as_u16(), 422);
                let start = format!("surfel.{}: must be within", knob.name);
                assert!(error.detail().starts_with(&start) && error.detail().contains(&most.to_string()), "{error:?}");
            }
        }
    }
}
