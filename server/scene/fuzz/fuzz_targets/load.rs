//! Any bytes: as an uploaded scene, as a view file and as an environment map.
#![no_main]

mod body;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| body::load(bytes));
