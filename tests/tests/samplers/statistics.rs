//! Chi-square over a family of tests, and z-scores.

/// Probability that a chi-square variable of `freedom` degrees exceeds `value`: the regularised upper incomplete gamma
/// function by its series below the mean and its continued fraction above.
pub(crate) fn chi_square_tail(value: f64, freedom: usize) -> f64 {
    let (a, x) = (freedom as f64 / 2.0, value / 2.0);
    if x <= 0.0 {
        return 1.0;
    }
    let scale = (a * x.ln() - x - log_gamma(a)).exp();
    if x < a + 1.0 {
        let (mut term, mut sum, mut n) = (1.0 / a, 1.0 / a, a);
        for _ in 0..10_000 {
            n += 1.0;
            term *= x / n;
            sum += term;
            if term < sum * 1e-15 {
                break;
            }
        }
        return 1.0 - sum * scale;
    }
    // Lentz' method.
    let tiny = 1e-300;
    let mut b = x + 1.0 - a;
    let mut c = 1.0 / tiny;
    let mut d = 1.0 / b;
    let mut fraction = d;
    for i in 1..10_000 {
        let step = -f64::from(i) * (f64::from(i) - a);
        b += 2.0;
        d = 1.0 / non_zero(step * d + b, tiny);
        c = non_zero(b + step / c, tiny);
        let factor = d * c;
        fraction *= factor;
        if (factor - 1.0).abs() < 1e-15 {
            break;
        }
    }
    scale * fraction
}

fn non_zero(x: f64, tiny: f64) -> f64 {
    if x.abs() < tiny { tiny } else { x }
}

/// ln Gamma by Stirling's series after shifting the argument up.
fn log_gamma(mut x: f64) -> f64 {
    let mut shift = 0.0;
    while x < 12.0 {
        shift -= x.ln();
        x += 1.0;
    }
    let square = x * x;
    let series = 1.0 / (12.0 * x) - 1.0 / (360.0 * x * square) + 1.0 / (1260.0 * x * square * square);
    shift + (x - 0.5) * x.ln() - x + 0.5 * (2.0 * std::f64::consts::PI).ln() + series
}

/// The p-value of counts against expected counts. Cells that expect fewer than five are pooled.
pub(crate) fn chi_square(observed: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(observed.len(), expected.len());
    let (mut statistic, mut cells) = (0.0, 0_usize);
    let (mut pooled_observed, mut pooled_expected) = (0.0, 0.0);
    let mut add = |observed: f64, expected: f64| {
        statistic += (observed - expected).powi(2) / expected;
        cells += 1;
    };
    for (&observed, &expected) in observed.iter().zip(expected) {
        if expected < 5.0 {
            pooled_observed += observed;
            pooled_expected += expected;
        } else {
            add(observed, expected);
        }
    }
    if pooled_expected >= 5.0 {
        add(pooled_observed, pooled_expected);
    } else {
        // Too few for the test, but a cell with probability 0 must stay empty.
        assert!(
            pooled_observed <= pooled_expected + 6.0 * (pooled_expected.sqrt() + 1.0),
            "{pooled_observed} in cells that expect {pooled_expected}"
        );
    }
    chi_square_tail(statistic, cells.saturating_sub(1).max(1))
}

/// p-values of a suite, of which the smallest is tested, so that the whole suite fails by chance once in a hundred runs
/// with new seeds; with fixed seeds the result is deterministic.
#[derive(Default)]
pub(crate) struct Suite {
    results: Vec<(String, f64)>,
}

const SIGNIFICANCE: f64 = 0.01;

impl Suite {
    pub(crate) fn add(&mut self, name: String, p_value: f64) {
        self.results.push((name, p_value));
    }

    /// Sidak's correction for the number of tests.
    pub(crate) fn judge(&self) {
        let threshold = 1.0 - (1.0 - SIGNIFICANCE).powf(1.0 / self.results.len() as f64);
        let failed: Vec<String> =
            self.results.iter().filter(|(_, p)| *p < threshold).map(|r| format!("{r:?}")).collect();
        assert!(failed.is_empty(), "{} of {} below {threshold:.2e}: {failed:#?}", failed.len(), self.results.len());
    }
}

/// Mean and standard error.
pub(crate) fn mean_and_error(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let count = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / count;
    let variance = values.map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
    (mean, (variance / count).sqrt())
}

#[test]
fn the_tail_agrees_with_tables() {
    // 5 % points of the distribution.
    for (freedom, value) in [(1, 3.841), (5, 11.070), (30, 43.773), (100, 124.342)] {
        assert!((chi_square_tail(value, freedom) - 0.05).abs() < 1e-4, "{freedom}");
    }
    assert!((chi_square_tail(2.0, 2) - (-1.0_f64).exp()).abs() < 1e-9);
}

#[test]
fn a_wrong_distribution_is_told_from_a_right_one() {
    let right = chi_square(&[1010.0, 990.0, 1005.0, 995.0], &[1000.0; 4]);
    let wrong = chi_square(&[1200.0, 900.0, 1000.0, 900.0], &[1000.0; 4]);
    assert!(right > 0.5 && wrong < 1e-6, "{right} {wrong}");
}
