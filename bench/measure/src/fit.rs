//! Lines through logarithms: how fast something falls or grows, and where it crosses a value.

/// Least-squares exponent b of y = a x^b; `None` with less than two different positive points.
pub fn exponent(points: &[(f64, f64)]) -> Option<f64> {
    let logs: Vec<_> = points.iter().filter(|(x, y)| *x > 0.0 && *y > 0.0).map(|(x, y)| (x.ln(), y.ln())).collect();
    let count = logs.len() as f64;
    let (x_mean, y_mean) =
        (logs.iter().map(|p| p.0).sum::<f64>() / count, logs.iter().map(|p| p.1).sum::<f64>() / count);
    let covariance: f64 = logs.iter().map(|(x, y)| (x - x_mean) * (y - y_mean)).sum();
    let variance: f64 = logs.iter().map(|(x, _)| (x - x_mean).powi(2)).sum();
    (logs.len() >= 2 && variance > 0.0).then(|| covariance / variance)
}

/// Where a falling error reached a goal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reached {
    /// The first point was already there: at or below this cost.
    Below(f64),
    /// Between two points, interpolated in logarithms.
    At(f64),
    /// Not by the last point; its cost.
    Not(f64),
}

impl Reached {
    /// The cost, whatever it means.
    pub fn cost(self) -> f64 {
        let (Self::Below(cost) | Self::At(cost) | Self::Not(cost)) = self;
        cost
    }
}

impl std::fmt::Display for Reached {
    /// Three digits, with `<` and `>` before bounds.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mark = match self {
            Self::Below(_) => "<",
            Self::At(_) => "",
            Self::Not(_) => ">",
        };
        let cost = self.cost();
        let digits = if cost < 10.0 { 2 } else { usize::from(cost < 100.0) };
        write!(f, "{mark}{cost:.digits$}")
    }
}

/// Cost at which the error of points (cost, error), by rising cost, first reaches a goal; `None` without a point.
pub fn cost_to_error(points: &[(f64, f64)], goal: f64) -> Option<Reached> {
    let &(first_cost, first_error) = points.first()?;
    if first_error <= goal {
        return Some(Reached::Below(first_cost));
    }
    for pair in points.windows(2) {
        let [(cost_0, error_0), (cost_1, error_1)] = [pair[0], pair[1]];
        if error_1 <= goal && goal < error_0 {
            // An error of nothing has no logarithm.
            let share = (error_0 / goal).ln() / (error_0 / error_1.max(1e-9)).ln();
            return Some(Reached::At((cost_0.ln() + share * (cost_1 / cost_0).ln()).exp()));
        }
    }
    points.last().map(|&(cost, _)| Reached::Not(cost))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponents_of_power_laws_are_found() {
        let points: Vec<_> = [1.0, 2.0, 5.0, 40.0].iter().map(|&x: &f64| (x, 3.0 * x.powf(-0.5))).collect();
        assert!((exponent(&points).expect("four points") + 0.5).abs() < 1e-12);
        assert_eq!(exponent(&points[..1]), None);
        assert_eq!(exponent(&[(1.0, 2.0), (1.0, 3.0), (0.0, 1.0)]), None);
    }

    #[test]
    fn a_goal_is_found_between_points() {
        let points = [(1.0, 0.1), (4.0, 0.05), (16.0, 0.025)];
        assert_eq!(cost_to_error(&points, 0.2), Some(Reached::Below(1.0)));
        assert_eq!(cost_to_error(&points, 0.01), Some(Reached::Not(16.0)));
        let Some(Reached::At(cost)) = cost_to_error(&points, 0.05 / 2_f64.sqrt()) else { panic!("it lies between") };
        assert!((cost - 8.0).abs() < 1e-9, "{cost}");
        assert_eq!(cost_to_error(&[], 1.0), None);
        assert_eq!(Reached::Below(0.081).to_string(), "<0.08");
        assert_eq!(Reached::Not(12.34).to_string(), ">12.3");
    }
}
