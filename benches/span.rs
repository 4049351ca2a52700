//! Times as distributions: what they have in common, and what only one in a thousand exceeds.

use std::time::Duration;

/// The statistics that are told, by name.
pub(crate) const TOLD: [(&str, f64); 3] = [("p50", 0.5), ("p99", 0.99), ("p99.9", 0.999)];

/// Times of one kind, in microseconds.
#[derive(Debug, Default)]
pub(crate) struct Times {
    micros: Vec<f64>,
}

impl Times {
    pub(crate) fn add(&mut self, time: Duration) {
        self.micros.push(time.as_secs_f64() * 1e6);
    }

    pub(crate) fn add_micros(&mut self, micros: f64) {
        self.micros.push(micros);
    }

    /// What this share of them does not exceed.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "a share of a number of times"
    )]
    pub(crate) fn share(&mut self, share: f64) -> f64 {
        self.micros.sort_by(f64::total_cmp);
        let index = (self.micros.len() as f64 * share) as usize;
        self.micros.get(index.min(self.micros.len().saturating_sub(1))).copied().unwrap_or(f64::NAN)
    }
}
