//! Animations: key frames decoded once, interpolated at any time.

use super::accessor::Reader;
use super::check::{clip, invalid};
use super::document::{AnimationSampler, item};
use crate::SceneError;

/// A point in time of an animation.
#[derive(Clone, Debug, PartialEq)]
pub struct Instant {
    /// Index or name of the animation.
    pub animation: AnimationRef,
    /// Seconds from its start.
    pub time_secs: f64,
}

/// How a view file names an animation.
#[derive(Clone, Debug, PartialEq)]
pub enum AnimationRef {
    /// Position in the file.
    Index(usize),
    /// Name in the file.
    Name(String),
}

/// What a clip sets on a node; `None` keeps the file's value.
#[derive(Clone, Debug, Default)]
pub(crate) struct NodeOverride {
    pub(crate) translation: Option<[f64; 3]>,
    pub(crate) rotation: Option<[f64; 4]>,
    pub(crate) scale: Option<[f64; 3]>,
    pub(crate) weights: Option<Vec<f64>>,
}

/// One animation of the file, decoded.
#[derive(Debug)]
pub(crate) struct Clip {
    channels: Vec<Channel>,
    node_count: usize,
}

/// Key frames of one property of one node.
#[derive(Debug)]
struct Channel {
    node: usize,
    property: Property,
    keys: Keys,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Property {
    Translation,
    Rotation,
    Scale,
    Weights,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Interpolation {
    Linear,
    Step,
    Cubic,
}

#[derive(Debug)]
struct Keys {
    interpolation: Interpolation,
    /// Seconds, not decreasing, at least one.
    times: Vec<f32>,
    /// Groups of `width` numbers: one a key, or in-tangent, value and out-tangent of each key for cubic splines.
    values: Vec<f32>,
    width: usize,
}

impl Clip {
    /// Decodes the animation that `reference` names.
    pub(crate) fn decode(reader: &Reader<'_>, reference: &AnimationRef) -> Result<Self, SceneError> {
        let animations = &reader.document.animations;
        // the member of the view file by which an instant is chosen
        let asked_by = "pose.animation";
        let index = match reference {
            AnimationRef::Index(index) => *index,
            AnimationRef::Name(name) => animations
                .iter()
                .position(|animation| animation.name.as_deref() == Some(name))
                .ok_or_else(|| invalid(asked_by, format!("no animation is named {:?}", clip(name))))?,
        };
        let animation = item(animations, index, "animations", asked_by)?;
        let node_count = reader.document.nodes.len();
        let mut channels = Vec::new();
        for (c, channel) in animation.channels.iter().enumerate() {
            let field = format!("animations[{index}].channels[{c}]");
            let Some(node) = channel.target.node else { continue };
            if node >= node_count {
                return Err(invalid(format!("{field}.target.node"), "is out of range"));
            }
            let sampler = item(&animation.samplers, channel.sampler, "samplers", &field)?;
            let property = match channel.target.path.as_str() {
                "translation" => Property::Translation,
                "rotation" => Property::Rotation,
                "scale" => Property::Scale,
                "weights" => Property::Weights,
                _ => continue, // other paths belong to extensions, which are warned of by name
            };
            let keys = match property {
                Property::Translation | Property::Scale => Keys::vectors::<3>(reader, sampler, &field)?,
                Property::Rotation => Keys::vectors::<4>(reader, sampler, &field)?,
                Property::Weights => Keys::weights(reader, sampler, &field)?,
            };
            channels.push(Channel { node, property, keys });
        }
        Ok(Self { channels, node_count })
    }

    /// What the clip sets at a time, one entry for each node of the file.
    pub(crate) fn at(&self, time_secs: f64) -> Vec<NodeOverride> {
        let mut nodes = vec![NodeOverride::default(); self.node_count];
        for Channel { node, property, keys } in &self.channels {
            let node = &mut nodes[*node];
            match property {
                Property::Translation => node.translation = Some(keys.vector(time_secs)),
                Property::Rotation => node.rotation = Some(keys.rotation(time_secs)),
                Property::Scale => node.scale = Some(keys.vector(time_secs)),
                Property::Weights => node.weights = Some(keys.interpolate(time_secs)),
            }
        }
        nodes
    }
}

/// Where an instant lies between two keys.
#[derive(Clone, Copy, Debug)]
struct Segment {
    /// Key at or before the instant.
    key: usize,
    /// Key after it, or the same one at the ends.
    next: usize,
    /// Fraction of the way to the next key, in [0, 1].
    fraction: f64,
    /// Time between the keys, seconds.
    span_secs: f64,
}

impl Segment {
    /// Finds the segment; instants before the first or after the last key are clamped to them.
    fn find(times: &[f32], time_secs: f64) -> Self {
        let seconds = |key: usize| f64::from(times[key]);
        let last = times.len() - 1;
        let key = times.partition_point(|time| f64::from(*time) <= time_secs).saturating_sub(1).min(last);
        let next = (key + 1).min(last);
        let span_secs = seconds(next) - seconds(key);
        let fraction = if span_secs > 0.0 { ((time_secs - seconds(key)) / span_secs).clamp(0.0, 1.0) } else { 0.0 };
        Self { key, next, fraction, span_secs: span_secs.max(0.0) }
    }
}

impl Keys {
    /// Reads interpolation and times; values follow.
    fn timed(reader: &Reader<'_>, sampler: &AnimationSampler, field: &str) -> Result<Self, SceneError> {
        let interpolation = match sampler.interpolation.as_deref() {
            None | Some("LINEAR") => Interpolation::Linear,
            Some("STEP") => Interpolation::Step,
            Some("CUBICSPLINE") => Interpolation::Cubic,
            Some(other) => return Err(invalid(field, format!("interpolation {:?} is unknown", clip(other)))),
        };
        let times = reader.floats::<1>(sampler.input, field)?.into_flattened();
        if times.is_empty() {
            return Err(invalid(field, "has no keys"));
        }
        if times.windows(2).any(|pair| pair[1] < pair[0]) {
            return Err(invalid(field, format!("accessors[{}] holds times that decrease", sampler.input)));
        }
        Ok(Self { interpolation, times, values: Vec::new(), width: 0 })
    }

    fn vectors<const N: usize>(
        reader: &Reader<'_>,
        sampler: &AnimationSampler,
        field: &str,
    ) -> Result<Self, SceneError> {
        let keys = Self::timed(reader, sampler, field)?;
        let values = reader.floats::<N>(sampler.output, field)?;
        let (found, count, needed) = (values.len(), keys.times.len(), keys.group_count());
        if found < needed {
            return Err(invalid(field, format!("output has {found} elements; {count} keys need {needed}")));
        }
        Ok(Self { values: values.into_flattened(), width: N, ..keys })
    }

    /// Morph weights: as many a key as the output has room for.
    fn weights(reader: &Reader<'_>, sampler: &AnimationSampler, field: &str) -> Result<Self, SceneError> {
        let keys = Self::timed(reader, sampler, field)?;
        let values = reader.floats::<1>(sampler.output, field)?.into_flattened();
        let width = values.len() / keys.group_count();
        Ok(Self { values, width, ..keys })
    }

    /// Groups of numbers that all keys have in the file.
    fn group_count(&self) -> usize {
        self.times.len() * if self.interpolation == Interpolation::Cubic { 3 } else { 1 }
    }

    fn value(&self, group: usize, k: usize) -> f64 {
        f64::from(self.values[group * self.width + k])
    }

    fn interpolate(&self, time_secs: f64) -> Vec<f64> {
        let Segment { key, next, fraction: u, span_secs } = Segment::find(&self.times, time_secs);
        (0..self.width)
            .map(|k| match self.interpolation {
                Interpolation::Step => self.value(if u >= 1.0 { next } else { key }, k),
                Interpolation::Linear => self.value(key, k) * (1.0 - u) + self.value(next, k) * u,
                Interpolation::Cubic => {
                    // each key holds in-tangent, value, out-tangent
                    let (p0, m0) = (self.value(3 * key + 1, k), span_secs * self.value(3 * key + 2, k));
                    let (p1, m1) = (self.value(3 * next + 1, k), span_secs * self.value(3 * next, k));
                    let (u2, u3) = (u * u, u * u * u);
                    (2.0 * u3 - 3.0 * u2 + 1.0) * p0
                        + (u3 - 2.0 * u2 + u) * m0
                        + (3.0 * u2 - 2.0 * u3) * p1
                        + (u3 - u2) * m1
                }
            })
            .collect()
    }

    fn vector(&self, time_secs: f64) -> [f64; 3] {
        let result = self.interpolate(time_secs);
        [result[0], result[1], result[2]]
    }

    fn rotation(&self, time_secs: f64) -> [f64; 4] {
        if self.interpolation != Interpolation::Linear {
            let result = self.interpolate(time_secs);
            return [result[0], result[1], result[2], result[3]];
        }
        let segment = Segment::find(&self.times, time_secs);
        let quaternion = |group: usize| std::array::from_fn(|k| self.value(group, k));
        slerp(quaternion(segment.key), quaternion(segment.next), segment.fraction)
    }
}

/// Spherical interpolation along the shorter arc.
fn slerp(a: [f64; 4], mut b: [f64; 4], u: f64) -> [f64; 4] {
    let mut dot: f64 = a.iter().zip(b).map(|(x, y)| x * y).sum();
    if dot < 0.0 {
        b = b.map(|x| -x);
        dot = -dot;
    }
    let (wa, wb) = if dot < 0.9995 {
        let angle = dot.min(1.0).acos();
        (((1.0 - u) * angle).sin() / angle.sin(), (u * angle).sin() / angle.sin())
    } else {
        (1.0 - u, u)
    };
    std::array::from_fn(|k| wa * a[k] + wb * b[k])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instants_outside_the_keys_are_clamped() {
        let times = [1.0, 2.0, 4.0];
        let at = |time| {
            let segment = Segment::find(&times, time);
            (segment.key, segment.next, segment.fraction)
        };
        assert_eq!(at(-5.0), (0, 1, 0.0));
        assert_eq!(at(1.5), (0, 1, 0.5));
        assert_eq!(at(3.0), (1, 2, 0.5));
        assert_eq!(at(99.0), (2, 2, 0.0));
    }

    #[test]
    fn slerp_takes_the_shorter_arc_at_constant_speed() {
        let half = |angle: f64| [0.0, 0.0, (angle / 2.0).sin(), (angle / 2.0).cos()];
        let third = slerp(half(0.3), half(1.2), 1.0 / 3.0);
        let flipped = slerp(half(0.3), half(1.2).map(|x| -x), 1.0 / 3.0);
        for k in 0..4 {
            assert!((third[k] - half(0.6)[k]).abs() < 1e-12);
            assert!((third[k] - flipped[k]).abs() < 1e-12);
        }
    }

    #[test]
    fn cubic_splines_follow_the_hermite_form() {
        // value 1 with out-tangent 3 at time 0, then value 2 with in-tangent -1 at time 2
        let values = vec![0.0, 1.0, 3.0, -1.0, 2.0, 0.0];
        let keys = Keys { interpolation: Interpolation::Cubic, times: vec![0.0, 2.0], values, width: 1 };
        let result = keys.interpolate(1.0);
        assert!((result[0] - (0.5 * 1.0 + 0.125 * 6.0 + 0.5 * 2.0 - 0.125 * -2.0)).abs() < 1e-12);
    }
}
