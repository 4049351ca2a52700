//! Configurations for tests: the built-in set, changed in single lines.

/// The set that is compiled into `ccu`.
const BUILT_IN: &str = include_str!("../../config/supersigma.toml");

/// The built-in set with limits that also a busy machine keeps. Where a limit is what is tested, set it with [`changed`].
#[must_use]
pub fn patient() -> String {
    let text = changed(BUILT_IN, "lead_ms = 40 ", "lead_ms = 300 ");
    let text = changed(&text, "answer_ms = 500 ", "answer_ms = 30000 ");
    let text = changed(&text, "overdue_ms = 500 ", "overdue_ms = 30000 ");
    changed(&text, "silent_ms = 450 ", "silent_ms = 30000 ")
}

/// `text` with one thing changed.
#[must_use]
pub fn changed(text: &str, from: &str, to: &str) -> String {
    assert_eq!(text.matches(from).count(), 1, "{from:?} must stand once in the configuration");
    text.replace(from, to)
}
