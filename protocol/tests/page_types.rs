//! The messages for the page, generated from the Rust types: TypeScript types that the page's code is checked with, and
//! the schema that the page checks received messages with. `SURFELCAST_UPDATE=1` writes both files instead of comparing
//! them.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde_json::{Map, Value};
use surfelcast_protocol::client::ClientEnvelope;
use surfelcast_protocol::server::ServerMessage;

const HEAD: &str = "/**
 * Generated from protocol/src by protocol/tests/page_types.rs. Do not edit: change the Rust types, then run
 * `SURFELCAST_UPDATE=1 cargo nextest run --release -p surfelcast-protocol --test page_types`.
 */
";

/// Keywords that the page's check uses.
const CHECKED: [&str; 11] = [
    "$ref",
    "additionalProperties",
    "anyOf",
    "default",
    "items",
    "maxItems",
    "minItems",
    "oneOf",
    "properties",
    "required",
    "type",
];

fn schema_of<T: JsonSchema>(settings: SchemaSettings) -> Value {
    settings.into_generator().into_root_schema_for::<T>().to_value()
}

/// Entries of an object in the order of their names, whatever the features of `serde_json`.
fn sorted(object: &Value) -> BTreeMap<&str, &Value> {
    object.as_object().into_iter().flatten().map(|(name, value)| (name.as_str(), value)).collect()
}

/// The tagged variants of a message.
fn variants(schema: &Value) -> impl Iterator<Item = &Value> {
    schema["oneOf"].as_array().into_iter().flatten()
}

fn name_of(reference: &str) -> &str {
    reference.trim_start_matches("#/$defs/")
}

/// The names of an enum without data.
fn names_of(schema: &Value) -> Option<Vec<&str>> {
    if let Some(name) = schema["const"].as_str() {
        return Some(vec![name]);
    }
    let list = schema["enum"].as_array().or_else(|| schema["oneOf"].as_array())?;
    list.iter().map(|item| item.as_str().or_else(|| item["const"].as_str())).collect()
}

/// A schema with what the page checks. Names of an enum are not, so that a newer server may have more of them.
fn checked(schema: &Value) -> Value {
    if names_of(schema).is_some() {
        return Value::Object(Map::from_iter([("type".to_owned(), "string".into())]));
    }
    // `true` accepts everything, as an empty schema does.
    let Value::Object(_) = schema else { return Value::Object(Map::new()) };
    let keywords = sorted(schema).into_iter().filter(|(keyword, _)| CHECKED.contains(keyword));
    let entry = |(keyword, value): (&str, &Value)| {
        let value = match (keyword, value) {
            ("properties", _) => {
                sorted(value).into_iter().map(|(name, field)| (name.to_owned(), checked(field))).collect()
            }
            ("anyOf" | "oneOf", Value::Array(list)) => list.iter().map(checked).collect(),
            ("items" | "additionalProperties", _) => checked(value),
            _ => value.clone(),
        };
        // It does not matter to the page whether a second alternative fits as well.
        (keyword.replace("oneOf", "anyOf"), value)
    };
    keywords.map(entry).collect()
}

/// The TypeScript type of a schema.
fn type_of(schema: &Value) -> String {
    let union = |mut parts: Vec<String>| {
        parts.dedup();
        parts.join(" | ")
    };
    if let Some(names) = names_of(schema) {
        return union(names.iter().map(|name| format!("'{name}'")).collect());
    }
    if let Some(reference) = schema["$ref"].as_str() {
        return name_of(reference).to_owned();
    }
    if let Some(parts) = schema["anyOf"].as_array().or_else(|| schema["oneOf"].as_array()) {
        return union(parts.iter().map(type_of).collect());
    }
    let named = |name: &str| match name {
        "integer" => "number".to_owned(),
        "array" => array_type_of(schema),
        "object" if schema["properties"].is_object() => format!("{{ {} }}", fields_of(schema, "").replace('\n', " ")),
        "object" => format!("Record<string, {}>", type_of(&schema["additionalProperties"])),
        other => other.to_owned(),
    };
    match &schema["type"] {
        Value::String(name) => named(name),
        Value::Array(names) => union(names.iter().filter_map(Value::as_str).map(named).collect()),
        _ => "unknown".to_owned(),
    }
}

fn array_type_of(schema: &Value) -> String {
    let item = type_of(&schema["items"]);
    match (schema["minItems"].as_u64(), schema["maxItems"].as_u64()) {
        (Some(3), Some(3)) if item == "number" => "Vec3".to_owned(),
        (Some(least), Some(most)) if least == most => format!("[{}]", vec![item; least as usize].join(", ")),
        _ if item.contains(' ') => format!("({item})[]"),
        _ => format!("{item}[]"),
    }
}

/// The documentation of a schema as a comment.
fn comment(schema: &Value, indent: &str) -> String {
    match schema["description"].as_str() {
        Some(text) => {
            format!("{indent}/** {} */\n", text.replace('\n', &format!("\n{indent} * ")).replace("* \n", "*\n"))
        }
        None => String::new(),
    }
}

/// The fields of an object, one a line, each with its documentation; a tag comes first.
fn fields_of(schema: &Value, indent: &str) -> String {
    let required: Vec<&str> = schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    let mut fields: Vec<(&str, &Value)> = sorted(&schema["properties"]).into_iter().collect();
    fields.sort_by_key(|(_, field)| field["const"].is_null());
    let mut text = String::new();
    for (name, field) in fields {
        let mark = if required.contains(&name) { "" } else { "?" };
        let _ = writeln!(text, "{}{indent}{name}{mark}: {};", comment(field, indent), type_of(field));
    }
    text
}

/// One of the tagged variants of a type: its fields, and those of a definition.
fn variant_type(variant: &Value) -> String {
    let fields = fields_of(variant, "    ");
    let own = match fields.lines().count() {
        1 => format!("{{ {} }}", fields.trim().trim_end_matches(';')),
        _ => format!("{{\n{fields}  }}"),
    };
    match variant["$ref"].as_str() {
        Some(reference) => format!("({own} & {})", name_of(reference)),
        None => own,
    }
}

/// A declaration with its documentation.
fn declaration(name: &str, schema: &Value) -> String {
    let fields = schema["properties"].is_object().then(|| format!("{{\n{}}}", fields_of(schema, "  ")));
    let has_variants = names_of(schema).is_none() && schema["oneOf"].is_array();
    let mut union = String::new();
    for variant in variants(schema).filter(|_| has_variants) {
        let _ = write!(union, "\n{}  | {}", comment(variant, "  "), variant_type(variant));
    }
    let text = match fields {
        Some(fields) if has_variants => format!("type {name} = {fields} & ({union}\n);"),
        Some(fields) => format!("interface {name} {fields}"),
        None if has_variants => format!("type {name} ={union};"),
        None => format!("type {name} = {};", type_of(schema)),
    };
    format!("\n{}export {text}\n", comment(schema, ""))
}

/// The file of types.
fn types() -> String {
    let settings = || SchemaSettings::draft2020_12().for_serialize();
    let (server, client) = (schema_of::<ServerMessage>(settings()), schema_of::<ClientEnvelope>(settings()));
    let mut definitions = sorted(&server["$defs"]);
    definitions.extend(sorted(&client["$defs"]));
    definitions.insert("ServerMessage", &server);
    definitions.insert("ClientMessage", &client);
    let declarations: String = definitions.into_iter().map(|(name, schema)| declaration(name, schema)).collect();
    format!("{HEAD}\nexport type Vec3 = [number, number, number];\n{declarations}")
}

/// The module of schemas.
fn schemas() -> String {
    let schema = schema_of::<ServerMessage>(SchemaSettings::draft2020_12().for_deserialize());
    let table = |name: &str, entries: Vec<(&str, &Value)>| {
        let mut text =
            format!("\n/** @type {{Record<string, import('./check.js').Schema>}} */\nexport const {name} = {{\n");
        for (name, schema) in entries {
            let _ = writeln!(text, "  {name:?}: {},", checked(schema));
        }
        text + "};\n"
    };
    let messages =
        variants(&schema).filter_map(|variant| Some((variant["properties"]["t"]["const"].as_str()?, variant)));
    let (definitions, messages) = (sorted(&schema["$defs"]).into_iter().collect(), messages.collect());
    format!("{HEAD}{}{}", table("definitions", definitions), table("messages", messages))
}

#[test]
fn the_page_has_the_types_and_the_schema_of_the_messages() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../web-client/src/protocol");
    for (name, text) in [("types.d.ts", types()), ("schema.js", schemas())] {
        let path = folder.join(name);
        if std::env::var_os("SURFELCAST_UPDATE").is_some() {
            std::fs::write(&path, &text).expect("the folder of the web client can be written");
        }
        let present = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(present == text, "{name} does not match the Rust types: run this test with SURFELCAST_UPDATE=1");
    }
}
