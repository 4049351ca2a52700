//! The page and its parts, as they are in the binary.

/// A file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Asset {
    pub(super) name: &'static str,
    /// Its `Content-Type`.
    pub(super) kind: &'static str,
    pub(super) text: &'static str,
}

macro_rules! asset {
    ($name:literal, $kind:expr) => {
        Asset { name: $name, kind: $kind, text: include_str!(concat!("assets/", $name)) }
    };
}

const SCRIPT: &str = "text/javascript; charset=utf-8";

/// All of them.
pub(super) const ALL: &[Asset] = &[
    asset!("index.html", "text/html; charset=utf-8"),
    asset!("style.css", "text/css; charset=utf-8"),
    asset!("icon.svg", "image/svg+xml"),
    asset!("axes.js", SCRIPT),
    asset!("dom.js", SCRIPT),
    asset!("frames.js", SCRIPT),
    asset!("main.js", SCRIPT),
    asset!("orders.js", SCRIPT),
    asset!("panel.js", SCRIPT),
    asset!("plot.js", SCRIPT),
    asset!("stream.js", SCRIPT),
];

/// The one with this name.
pub(super) fn find(name: &str) -> Option<&'static Asset> {
    ALL.iter().find(|asset| asset.name == name)
}
