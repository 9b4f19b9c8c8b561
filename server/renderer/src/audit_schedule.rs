//! When an image's error is audited on its way to a goal.

/// Samples a pixel at the first audit: fewer say little about the variance of a pixel.
pub(crate) const FIRST_AUDIT: u32 = 16;
/// Least factor of samples between audits: closer ones would see nearly the same image.
const LEAST_GROWTH: f64 = 1.05;

/// Samples a pixel at which to audit next.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AuditSchedule {
    next: u32,
}

impl Default for AuditSchedule {
    fn default() -> Self {
        Self { next: FIRST_AUDIT }
    }
}

impl AuditSchedule {
    /// Samples a pixel of the next audit.
    pub(crate) fn next(self) -> u32 {
        self.next
    }

    /// Plans the audit after one at `samples` that found the error to be below `bound`: where the error, which falls
    /// with the root of the samples, should reach the goal, but at no more than `most_growth` times the samples, since
    /// it may fall faster or have been audited too high.
    pub(crate) fn plan(&mut self, samples: u32, bound: f64, goal: f64, most_growth: f64) {
        let samples = f64::from(samples.max(1));
        let at_goal = samples * (bound / goal).powi(2);
        // `max` drops NaN, so an error that is not a number is audited again soon.
        self.next = at_goal.max(samples * LEAST_GROWTH).min(samples * most_growth).ceil() as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn audits_come_where_the_goal_should_be_met() {
        let after = |samples, bound, goal, most_growth| {
            let mut schedule = AuditSchedule::default();
            schedule.plan(samples, bound, goal, most_growth);
            schedule.next()
        };
        assert_eq!(after(100, 0.011, 0.01, 1.5), 121);
        assert_eq!(after(100, 0.02, 0.01, 1.5), 150, "far away");
        assert_eq!(after(100, 0.01, 0.01, 1.5), 105, "all but there");
        assert_eq!(after(1, 0.01, 0.01, 1.25), 2, "always onwards");
        assert_eq!(after(100, f64::NAN, 0.01, 1.5), 105);
        assert_eq!(after(100, f64::INFINITY, 0.01, 1.5), 150);
        assert_eq!(after(u32::MAX, 1.0, 0.01, 1.5), u32::MAX);
    }
}
