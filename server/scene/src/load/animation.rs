//! Animation channels sampled at one instant.

use super::accessor::Reader;
use super::check::{clip, invalid};
use super::document::{AnimationSampler, item};
use crate::view::AnimationRef;
use crate::{Instant, SceneError};

/// What an animation sets on a node; `None` keeps the file's value.
#[derive(Clone, Debug, Default)]
pub(crate) struct PosedNode {
    pub(crate) translation: Option<[f64; 3]>,
    pub(crate) rotation: Option<[f64; 4]>,
    pub(crate) scale: Option<[f64; 3]>,
    pub(crate) weights: Option<Vec<f64>>,
}

/// Samples every channel of the animation at the instant. One entry a node; empty where there is no instant.
pub(crate) fn sample(reader: &Reader<'_>, instant: Option<&Instant>) -> Result<Vec<PosedNode>, SceneError> {
    let Some(instant) = instant else { return Ok(Vec::new()) };
    let animations = &reader.document.animations;
    let index = match &instant.animation {
        AnimationRef::Index(index) => *index,
        AnimationRef::Name(name) => animations
            .iter()
            .position(|animation| animation.name.as_deref() == Some(name))
            .ok_or_else(|| invalid("pose.animation", format!("no animation is named {:?}", clip(name))))?,
    };
    let animation = item(animations, index, "animations", "pose.animation")?;
    let mut posed = vec![PosedNode::default(); reader.document.nodes.len()];
    for (c, channel) in animation.channels.iter().enumerate() {
        let field = format!("animations[{index}].channels[{c}]");
        let Some(node) = channel.target.node else { continue };
        let node = posed.get_mut(node).ok_or_else(|| invalid(format!("{field}.target.node"), "is out of range"))?;
        let sampler = item(&animation.samplers, channel.sampler, "samplers", &field)?;
        match channel.target.path.as_str() {
            "translation" => node.translation = Some(vector(reader, sampler, instant.time_secs, &field)?),
            "rotation" => node.rotation = Some(rotation(reader, sampler, instant.time_secs, &field)?),
            "scale" => node.scale = Some(vector(reader, sampler, instant.time_secs, &field)?),
            "weights" => node.weights = Some(weights(reader, sampler, instant.time_secs, &field)?),
            _ => {} // other paths belong to extensions, which are warned of by name
        }
    }
    Ok(posed)
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
    fn find(times: &[[f32; 1]], time_secs: f64) -> Self {
        let seconds = |key: usize| f64::from(times[key][0]);
        let last = times.len() - 1;
        let key = times.partition_point(|time| f64::from(time[0]) <= time_secs).saturating_sub(1).min(last);
        let next = (key + 1).min(last);
        let span_secs = seconds(next) - seconds(key);
        let fraction = if span_secs > 0.0 { ((time_secs - seconds(key)) / span_secs).clamp(0.0, 1.0) } else { 0.0 };
        Self { key, next, fraction, span_secs: span_secs.max(0.0) }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Interpolation {
    Linear,
    Step,
    Cubic,
}

struct Keys {
    segment: Segment,
    interpolation: Interpolation,
    count: usize,
}

fn keys(reader: &Reader<'_>, sampler: &AnimationSampler, time: f64, field: &str) -> Result<Keys, SceneError> {
    let interpolation = match sampler.interpolation.as_deref() {
        None | Some("LINEAR") => Interpolation::Linear,
        Some("STEP") => Interpolation::Step,
        Some("CUBICSPLINE") => Interpolation::Cubic,
        Some(other) => return Err(invalid(field, format!("interpolation {:?} is unknown", clip(other)))),
    };
    let times = reader.floats::<1>(sampler.input, field)?;
    if times.is_empty() {
        return Err(invalid(field, "has no keys"));
    }
    if times.windows(2).any(|pair| pair[1][0] < pair[0][0]) {
        return Err(invalid(field, format!("accessors[{}] holds times that decrease", sampler.input)));
    }
    Ok(Keys { segment: Segment::find(&times, time), interpolation, count: times.len() })
}

/// Interpolates `width` numbers a key. `values(i)` is the i-th group of `width` numbers in the file.
fn interpolate(keys: &Keys, width: usize, values: impl Fn(usize, usize) -> f64) -> Vec<f64> {
    let Segment { key, next, fraction: u, span_secs } = keys.segment;
    (0..width)
        .map(|k| match keys.interpolation {
            Interpolation::Step => values(if u >= 1.0 { next } else { key }, k),
            Interpolation::Linear => values(key, k) * (1.0 - u) + values(next, k) * u,
            Interpolation::Cubic => {
                // each key holds in-tangent, value, out-tangent
                let (p0, m0) = (values(3 * key + 1, k), span_secs * values(3 * key + 2, k));
                let (p1, m1) = (values(3 * next + 1, k), span_secs * values(3 * next, k));
                let (u2, u3) = (u * u, u * u * u);
                (2.0 * u3 - 3.0 * u2 + 1.0) * p0
                    + (u3 - 2.0 * u2 + u) * m0
                    + (3.0 * u2 - 2.0 * u3) * p1
                    + (u3 - u2) * m1
            }
        })
        .collect()
}

/// Groups a key holds in the file.
fn groups(keys: &Keys) -> usize {
    keys.count * if keys.interpolation == Interpolation::Cubic { 3 } else { 1 }
}

fn outputs<const N: usize>(
    reader: &Reader<'_>,
    sampler: &AnimationSampler,
    keys: &Keys,
    field: &str,
) -> Result<Vec<[f32; N]>, SceneError> {
    let values = reader.floats::<N>(sampler.output, field)?;
    if values.len() < groups(keys) {
        let problem = format!("output has {} elements; {} keys need {}", values.len(), keys.count, groups(keys));
        return Err(invalid(field, problem));
    }
    Ok(values)
}

fn vector(reader: &Reader<'_>, sampler: &AnimationSampler, time: f64, field: &str) -> Result<[f64; 3], SceneError> {
    let keys = keys(reader, sampler, time, field)?;
    let values = outputs::<3>(reader, sampler, &keys, field)?;
    let result = interpolate(&keys, 3, |group, k| f64::from(values[group][k]));
    Ok([result[0], result[1], result[2]])
}

fn rotation(reader: &Reader<'_>, sampler: &AnimationSampler, time: f64, field: &str) -> Result<[f64; 4], SceneError> {
    let keys = keys(reader, sampler, time, field)?;
    let values = outputs::<4>(reader, sampler, &keys, field)?;
    if keys.interpolation != Interpolation::Linear {
        let result = interpolate(&keys, 4, |group, k| f64::from(values[group][k]));
        return Ok([result[0], result[1], result[2], result[3]]);
    }
    let quaternion = |group: usize| values[group].map(f64::from);
    Ok(slerp(quaternion(keys.segment.key), quaternion(keys.segment.next), keys.segment.fraction))
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

fn weights(reader: &Reader<'_>, sampler: &AnimationSampler, time: f64, field: &str) -> Result<Vec<f64>, SceneError> {
    let keys = keys(reader, sampler, time, field)?;
    let values = reader.floats::<1>(sampler.output, field)?;
    let width = values.len() / groups(&keys);
    Ok(interpolate(&keys, width, |group, k| f64::from(values[group * width + k][0])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instants_outside_the_keys_are_clamped() {
        let times = [[1.0], [2.0], [4.0]];
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
        let keys = Keys {
            segment: Segment { key: 0, next: 1, fraction: 0.5, span_secs: 2.0 },
            interpolation: Interpolation::Cubic,
            count: 2,
        };
        // value 1 with out-tangent 3, then value 2 with in-tangent -1
        let data = [0.0, 1.0, 3.0, -1.0, 2.0, 0.0];
        let result = interpolate(&keys, 1, |group, _| data[group]);
        assert!((result[0] - (0.5 * 1.0 + 0.125 * 6.0 + 0.5 * 2.0 - 0.125 * -2.0)).abs() < 1e-12);
    }
}
