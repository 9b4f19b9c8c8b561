//! When a picture's error is looked at again on its way to a goal.

/// Samples a pixel at which the error is first audited: fewer say little of a pixel's scatter.
pub(crate) const FIRST_AUDIT: u32 = 16;
/// Least factor between audits. Nearer ones would see nearly the same picture.
const LEAST_GROWTH: f64 = 1.05;

/// Samples at which to audit next: where the error, which falls with the root of the samples, should reach the goal, but no
/// further than `most_growth` times what there are, since it may fall faster or have been audited too high.
pub(crate) fn next_audit(samples: u32, error_bound: f64, goal: f64, most_growth: f64) -> u32 {
    let samples = f64::from(samples.max(1));
    let there = samples * (error_bound / goal).powi(2);
    // An error that is not a number is looked at again soon.
    there.max(samples * LEAST_GROWTH).min(samples * most_growth).ceil() as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn audits_come_where_the_goal_should_be_met() {
        assert_eq!(next_audit(100, 0.011, 0.01, 1.5), 121);
        assert_eq!(next_audit(100, 0.02, 0.01, 1.5), 150, "far away");
        assert_eq!(next_audit(100, 0.01, 0.01, 1.5), 105, "as good as there");
        assert_eq!(next_audit(1, 0.01, 0.01, 1.25), 2, "always onwards");
        assert_eq!(next_audit(100, f64::NAN, 0.01, 1.5), 105);
        assert_eq!(next_audit(100, f64::INFINITY, 0.01, 1.5), 150);
        assert_eq!(next_audit(u32::MAX, 1.0, 0.01, 1.5), u32::MAX);
    }
}
