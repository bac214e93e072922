//! Robust statistics of plain numbers; knows nothing of corners.

/// The mean; `None` of nothing.
#[allow(clippy::cast_precision_loss, reason = "counts far below 2^52")]
pub fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// The root of the mean square; `None` of nothing.
pub fn root_mean_square(values: &[f64]) -> Option<f64> {
    mean(&values.iter().map(|value| value * value).collect::<Vec<_>>()).map(f64::sqrt)
}

/// The standard error of the mean; `None` of fewer than two values.
#[allow(clippy::cast_precision_loss, reason = "counts far below 2^52")]
pub fn standard_error(values: &[f64]) -> Option<f64> {
    let average = mean(values)?;
    let count = values.len() as f64;
    (values.len() > 1).then(|| {
        let sum: f64 = values.iter().map(|value| (value - average).powi(2)).sum();
        (sum / (count - 1.0) / count).sqrt()
    })
}

/// The quantile at `probability` in \[0, 1\], interpolated linearly between order statistics
/// (Hyndman & Fan 1996, definition 7, as in NumPy); `None` of nothing.
#[allow(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "an index inside the slice"
)]
pub fn quantile(values: &[f64], probability: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let place = probability.clamp(0.0, 1.0) * last as f64;
    let below = place.floor() as usize;
    let above = (below + 1).min(last);
    Some(sorted[below] + (place - below as f64) * (sorted[above] - sorted[below]))
}

/// The median; `None` of nothing.
pub fn median(values: &[f64]) -> Option<f64> {
    quantile(values, 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_of_nothing_are_none() {
        assert_eq!((mean(&[]), median(&[]), root_mean_square(&[])), (None, None, None));
        assert_eq!(standard_error(&[1.0]), None);
    }

    #[test]
    fn quantiles_interpolate_between_order_statistics() {
        let values = [4.0, 1.0, 3.0, 2.0];
        assert_eq!(median(&values), Some(2.5));
        assert_eq!(quantile(&values, 0.0), Some(1.0));
        assert_eq!(quantile(&values, 1.0), Some(4.0));
        assert!((quantile(&values, 0.95).expect("some") - 3.85).abs() < 1e-12);
    }

    #[test]
    fn standard_error_of_a_known_sample() {
        assert!((standard_error(&[1.0, 3.0]).expect("two") - 1.0).abs() < 1e-12);
    }
}
