//! Why a point is as bright as it is: what the surfel cache holds there, and which surfels light it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What the surfel cache knows of the surface under a point of the picture.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Inspection {
    /// World space, metres.
    pub position: [f64; 3],
    /// World space, towards the viewer.
    pub normal: [f32; 3],
    /// Sum of the surfels' weights by distance and normal.
    pub coverage: f32,
    /// Sum of weights that also count visibility and rays.
    pub trust: f32,
    /// B (irradiance over pi) of sky and emission found directly, linear Rec. 709.
    pub direct: [f32; 3],
    /// B of light that has bounced at least once.
    pub indirect: [f32; 3],
    /// Surfels that light the point, the largest share first; at most 64.
    pub contributions: Vec<Contribution>,
}

/// One surfel's part in a point's light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Contribution {
    /// Surfel.
    pub id: u32,
    /// Share of the point's value; all shares add up to one.
    pub share: f32,
    /// Weight by distance and normal, before visibility and trust.
    pub weight: f32,
    /// Chance that the surfel sees the point, in [0, 1].
    pub visibility: f32,
    /// World space, metres.
    pub position: [f64; 3],
    /// World space.
    pub normal: [f32; 3],
    /// Metres.
    pub radius: f32,
    /// B of sky and emission found directly.
    pub direct: [f32; 3],
    /// B of light that has bounced at least once.
    pub indirect: [f32; 3],
    /// Rays behind the values.
    pub ray_count: f32,
    /// Standard error of the luminance of B.
    pub std_error: f32,
}

impl Inspection {
    /// The first number that is none: JSON has no word for it, so such an inspection cannot be sent.
    pub fn not_finite(&self) -> Option<String> {
        let all = |values: &[f32]| values.iter().all(|value| value.is_finite());
        let place = |values: &[f64; 3]| values.iter().all(|value| value.is_finite());
        let named =
            |fields: &[(&'static str, bool)]| fields.iter().find(|(_, is_finite)| !is_finite).map(|(name, _)| *name);
        let own = named(&[
            ("position", place(&self.position)),
            ("normal", all(&self.normal)),
            ("coverage", self.coverage.is_finite()),
            ("trust", self.trust.is_finite()),
            ("direct", all(&self.direct)),
            ("indirect", all(&self.indirect)),
        ]);
        own.map(str::to_owned).or_else(|| {
            self.contributions.iter().find_map(|part| {
                let field = named(&[
                    ("share", part.share.is_finite()),
                    ("weight", part.weight.is_finite()),
                    ("visibility", part.visibility.is_finite()),
                    ("position", place(&part.position)),
                    ("normal", all(&part.normal)),
                    ("radius", part.radius.is_finite()),
                    ("direct", all(&part.direct)),
                    ("indirect", all(&part.indirect)),
                    ("ray_count", part.ray_count.is_finite()),
                    ("std_error", part.std_error.is_finite()),
                ])?;
                Some(format!("{field} of surfel {}", part.id))
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_json_cannot_say_is_found_by_name() {
        let part = Contribution { id: 7, ..Contribution::default() };
        let good = Inspection { contributions: vec![part], ..Inspection::default() };
        assert_eq!(good.not_finite(), None);
        let own = Inspection { direct: [0.0, f32::NAN, 0.0], ..good.clone() };
        assert_eq!(own.not_finite().as_deref(), Some("direct"));
        let broken = Contribution { std_error: f32::INFINITY, ..part };
        let of_a_surfel = Inspection { contributions: vec![part, broken], ..good };
        assert_eq!(of_a_surfel.not_finite().as_deref(), Some("std_error of surfel 7"));
    }
}
