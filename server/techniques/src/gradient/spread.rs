//! The noise of the reconstruction, from that of values and differences.

/// Frequencies along each axis in the sum.
const FREQUENCIES: u32 = 64;

/// Factors on the variance of a value and of a difference in the variance of the least-squares image, for noise that
/// is the same everywhere and independent: in the Fourier domain u = (a V + D^T g) / (a + l) with l = 4 sin^2(x / 2) +
/// 4 sin^2(y / 2), so the factors are the means of a^2 / (a + l)^2 and l / (a + l)^2 over all frequencies.
pub(super) fn variance_factors(screen: f32) -> [f32; 2] {
    let a = f64::from(screen);
    let square = |k: u32| {
        let angle = std::f64::consts::PI * (f64::from(k) + 0.5) / f64::from(FREQUENCIES);
        4.0 * (angle * 0.5).sin().powi(2)
    };
    let (mut of_values, mut of_edges) = (0.0, 0.0);
    for y in 0..FREQUENCIES {
        for x in 0..FREQUENCIES {
            let l = square(x) + square(y);
            of_values += a * a / (a + l).powi(2);
            of_edges += l / (a + l).powi(2);
        }
    }
    let count = f64::from(FREQUENCIES * FREQUENCIES);
    [(of_values / count) as f32, (of_edges / count) as f32]
}

#[cfg(test)]
mod tests {
    use super::variance_factors;

    #[test]
    fn a_strong_screen_keeps_the_values_and_a_weak_one_the_differences() {
        let [values, edges] = variance_factors(1e6);
        assert!((values - 1.0).abs() < 1e-4 && edges < 1e-6, "{values} {edges}");
        let [values, edges] = variance_factors(0.04);
        assert!(values < 0.01 && (0.2..0.6).contains(&edges), "{values} {edges}");
    }
}
