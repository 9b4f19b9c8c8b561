//! The description of a render request, completed by what the renderer's catalogue offers.

use surfelcast_render_api::{Catalogue, Setting, SettingKind, TechniqueDescription};
use utoipa::Number;
use utoipa::openapi::schema::{AdditionalProperties, AnyOfBuilder, Object, ObjectBuilder, Schema, Type};
use utoipa::openapi::{OpenApi, Ref, RefOr};

/// Component of the request's schema.
const REQUEST: &str = "RenderRequest";

/// Names techniques, presets, settings and outputs in the description.
pub(crate) fn describe_catalogue(api: &mut OpenApi, catalogue: &Catalogue) {
    let Some(components) = &mut api.components else { return };
    for technique in catalogue.techniques.iter().filter(|technique| !technique.settings.is_empty()) {
        components.schemas.insert(component_of(technique), settings_schema(technique).into());
    }
    let Some(RefOr::T(Schema::Object(request))) = components.schemas.get_mut(REQUEST) else { return };
    let mut set = |field: &str, schema: RefOr<Schema>| request.properties.insert(field.to_owned(), schema);
    set("technique", names("Technique id.", catalogue.technique_ids().map(|(id, ..)| id), catalogue.default_technique));
    set("preset", preset_schema(catalogue));
    set("reconstruction", reconstruction_schema(catalogue));
    set("settings", choice_of_settings(catalogue));
    let outputs = catalogue.outputs().map(|(output, _)| output.id);
    set("aov", names("Extra output instead of radiance, as EXR or PNG.", outputs, ""));
}

fn component_of(technique: &TechniqueDescription) -> String {
    format!("Settings.{}", technique.id)
}

fn names<'a>(description: &str, names: impl Iterator<Item = &'a str>, default: &str) -> RefOr<Schema> {
    ObjectBuilder::new()
        .schema_type(Type::String)
        .enum_values(Some(names.collect::<Vec<_>>()))
        .default((!default.is_empty()).then(|| default.into()))
        .description(Some(description))
        .into()
}

fn preset_schema(catalogue: &Catalogue) -> RefOr<Schema> {
    let with_presets = || catalogue.techniques.iter().filter(|technique| !technique.presets.is_empty());
    let mut ids: Vec<&str> = Vec::new();
    for preset in with_presets().flat_map(|technique| technique.presets) {
        if !ids.contains(&preset.id) {
            ids.push(preset.id);
        }
    }
    let default = with_presets().find_map(TechniqueDescription::default_preset).map_or("", |preset| preset.id);
    let owners = catalogue.ids_where(|technique| !technique.presets.is_empty());
    let description = format!("Values of the technique's settings to start from. Of {owners}; others refuse it.");
    names(&description, ids.into_iter(), default)
}

fn reconstruction_schema(catalogue: &Catalogue) -> RefOr<Schema> {
    let setting = catalogue.techniques.iter().find_map(|technique| technique.setting("reconstruction"));
    let Some(Setting { kind: SettingKind::Choice { default, names: choices }, .. }) = setting else {
        return names("No technique has this setting.", std::iter::empty(), "");
    };
    let owners = catalogue.ids_where(|technique| technique.setting("reconstruction").is_some());
    let description = format!("The setting `reconstruction`. Of {owners}; others refuse all but none.");
    names(&description, choices.iter().copied(), default)
}

/// The settings of any technique.
fn choice_of_settings(catalogue: &Catalogue) -> RefOr<Schema> {
    let techniques = catalogue.techniques.iter().filter(|technique| !technique.settings.is_empty());
    techniques
        .fold(AnyOfBuilder::new(), |any, technique| any.item(Ref::from_schema_name(component_of(technique))))
        .description(Some("Values of the technique's settings, over the preset."))
        .into()
}

/// The settings of one technique: every one with what it takes, its default and what it does.
fn settings_schema(technique: &TechniqueDescription) -> Schema {
    let with = |object: ObjectBuilder, setting: &Setting| object.property(setting.id, setting_schema(setting));
    technique
        .settings
        .iter()
        .fold(ObjectBuilder::new().schema_type(Type::Object), with)
        .additional_properties(Some(AdditionalProperties::<Schema>::FreeForm(false)))
        .description(Some(format!(
            "Settings of the technique {}. Those left out are as in the preset; defaults are those without one.",
            technique.id
        )))
        .into()
}

fn setting_schema(setting: &Setting) -> Object {
    let unit = if setting.unit.is_empty() { String::new() } else { format!(" ({})", setting.unit) };
    let object = ObjectBuilder::new().description(Some(format!("{}{unit}", setting.help)));
    let object = match setting.kind {
        SettingKind::Number { range: [least, most], is_integer, .. } => object
            .schema_type(if is_integer { Type::Integer } else { Type::Number })
            .minimum(Some(Number::Float(least)))
            .maximum(Some(Number::Float(most))),
        SettingKind::Switch { .. } => object.schema_type(Type::Boolean),
        SettingKind::Choice { names, .. } => object.schema_type(Type::String).enum_values(Some(names.to_vec())),
    };
    object.default(Some(setting.default_value().into())).build()
}
