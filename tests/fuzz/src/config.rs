//! The text of a configuration.

use axis_worker::Card;
use ccu::executive::Knowledge;
use miette::{Diagnostic, NarratableReportHandler};
use supersigma_config::Config;

/// Loads `text`. Whoever holds a configuration may rely on it: machines can be made of it, and its text gives it back.
pub fn config(text: &str) {
    let config = match Config::from_toml(text, "garbage.toml") {
        Ok(config) => config,
        Err(error) => {
            let mut drawn = String::new();
            NarratableReportHandler::new().render_report(&mut drawn, &error).expect("drawing into a string");
            assert!(!error.faults().is_empty() && !error.to_string().is_empty());
            for fault in error.faults() {
                // Whoever looks there finds a line, or stands right behind the last one.
                assert!((1..=text.lines().count() + 1).contains(&fault.line()), "{fault}");
                assert!(fault.column() >= 1, "{fault}");
                for label in fault.labels().into_iter().flatten() {
                    let end = label.offset() + label.len();
                    assert!(
                        text.get(label.offset()..end).is_some(),
                        "{fault}: {label:?} of {} bytes",
                        text.len()
                    );
                }
            }
            return;
        }
    };
    let knowledge = Knowledge::new(config.clone()).expect("good ramps");
    for axis in &config.axes {
        assert!(knowledge.table(axis.address).is_ok());
        Card::axis(&config, axis.address).expect("a good axis").expect("it exists");
    }
    let _ = Card::digital(&config);
    assert_eq!(Config::from_toml(&config.to_toml(), "again.toml").expect("its own text"), config);
}
