//! Surfels as a PLY point cloud, binary little-endian, for any point cloud viewer.

use std::fmt::Write as _;

use glam::DVec3;
use surfelcast_scene::geometry::unpack_octahedral;

use crate::surfel::cache::ExportedSurfel;

const PROPERTIES: [(&str, &str); 16] = [
    ("double", "x"),
    ("double", "y"),
    ("double", "z"),
    ("float", "nx"),
    ("float", "ny"),
    ("float", "nz"),
    ("float", "radius"),
    ("float", "b_direct_red"),
    ("float", "b_direct_green"),
    ("float", "b_direct_blue"),
    ("float", "b_indirect_red"),
    ("float", "b_indirect_green"),
    ("float", "b_indirect_blue"),
    ("float", "rays"),
    ("float", "variance"),
    ("float", "age"),
];

/// The file's bytes. Positions are in world space, metres; `b_` is irradiance over pi, albedo left out.
pub(crate) fn encode(surfels: &[ExportedSurfel], origin: DVec3) -> Vec<u8> {
    let mut header = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", surfels.len());
    for (kind, name) in PROPERTIES {
        // Writing to a string cannot fail.
        let _ = writeln!(header, "property {kind} {name}");
    }
    let mut bytes = (header + "end_header\n").into_bytes();
    for ExportedSurfel { record, light } in surfels {
        let [x, y, z] = record.position.map(f64::from);
        for value in (origin + DVec3::new(x, y, z)).to_array() {
            bytes.extend_from_slice(&value.to_le_bytes());
        }
        let normal = unpack_octahedral(record.normal).to_array();
        let scalars = [light.ray_count, light.variance, light.age];
        let floats = normal.iter().chain([&record.radius]).chain(&light.direct).chain(&light.indirect).chain(&scalars);
        for value in floats {
            bytes.extend_from_slice(&value.to_le_bytes());
        }
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_header_states_what_follows() {
        let surfel = ExportedSurfel { record: bytemuck::Zeroable::zeroed(), light: bytemuck::Zeroable::zeroed() };
        let bytes = encode(&[surfel, surfel], DVec3::new(1e6, 0.0, -2.0));
        let end = b"end_header\n";
        let body = bytes.windows(end.len()).position(|w| w == end).expect("a header") + end.len();
        assert_eq!(bytes.len() - body, 2 * (3 * 8 + 13 * 4));
        assert_eq!(bytes[body..body + 8], 1e6_f64.to_le_bytes());
        assert!(String::from_utf8_lossy(&bytes[..body]).contains("element vertex 2\n"));
    }
}
