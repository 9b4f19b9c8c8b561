//! Identities that outlive a build: SHA-256 over canonical JSON.
//!
//! Canonical: keys are sorted, nothing is padded, and a number that is not whole by type is written as the bits of its
//! double-precision value, so that no printer of numbers has a say. Floats of single precision are widened, which is
//! exact.

use std::fmt::Write as _;

use serde::Serialize;
use serde_json::Value;
use sha2::{Digest as _, Sha256};

/// Hash over the canonical JSON of a value. Fails only for maps whose keys are no strings.
pub fn identity(value: &impl Serialize) -> Result<[u8; 32], serde_json::Error> {
    Ok(Sha256::digest(canonical_json(value)?).into())
}

/// The same in hexadecimal digits.
pub fn identity_hex(value: &impl Serialize) -> Result<String, serde_json::Error> {
    identity(value).map(hex::encode)
}

/// The text that is hashed.
pub fn canonical_json(value: &impl Serialize) -> Result<String, serde_json::Error> {
    let mut text = String::new();
    write(&mut text, &serde_json::to_value(value)?);
    Ok(text)
}

fn write(text: &mut String, value: &Value) {
    // Writing to a string cannot fail.
    match value {
        Value::Null | Value::Bool(_) | Value::String(_) => {
            let _ = write!(text, "{value}");
        }
        Value::Number(number) => {
            let _ = match (number.is_f64(), number.as_f64()) {
                (true, Some(float)) => write!(text, "\"f64:{:016x}\"", float.to_bits()),
                _ => write!(text, "{number}"),
            };
        }
        Value::Array(items) => {
            text.push('[');
            for (index, item) in items.iter().enumerate() {
                if index > 0 {
                    text.push(',');
                }
                write(text, item);
            }
            text.push(']');
        }
        Value::Object(fields) => {
            let mut sorted: Vec<_> = fields.iter().collect();
            sorted.sort_by_key(|(key, _)| *key);
            text.push('{');
            for (index, (key, field)) in sorted.into_iter().enumerate() {
                if index > 0 {
                    text.push(',');
                }
                let _ = write!(text, "{}:", Value::from(key.as_str()));
                write(text, field);
            }
            text.push('}');
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Serialize)]
    struct Sample {
        zebra: f32,
        apple: Vec<u64>,
        text: &'static str,
    }

    #[test]
    fn keys_are_sorted_and_numbers_are_bits() {
        let sample = Sample { zebra: 0.1, apple: vec![1, u64::MAX], text: "a \"b\"\n" };
        let text = canonical_json(&sample).expect("encodes");
        let bits = f64::from(0.1_f32).to_bits();
        let expected = format!(r#"{{"apple":[1,18446744073709551615],"text":"a \"b\"\n","zebra":"f64:{bits:016x}"}}"#);
        assert_eq!(text, expected);
        // Fixed for good: files and tags of earlier runs depend on it.
        let hash = identity_hex(&sample).expect("encodes");
        assert_eq!(hash, "261ae4da0c1449c13d32ce3eeaeced6eb8c9fb460db76978163157c793d1ac46");
    }

    #[test]
    fn the_smallest_difference_makes_another_identity() {
        let of = |zebra: f32| identity(&Sample { zebra, apple: Vec::new(), text: "" }).expect("encodes");
        assert_ne!(of(1.0), of(1.0_f32.next_up()));
        assert_ne!(of(0.0), of(-0.0));
        assert_eq!(of(1.0), of(1.0));
    }
}
