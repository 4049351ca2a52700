//! Pixels: the SVG rendered, with a font that is compiled in (Noto Sans). No font of the system is looked for.

use std::sync::Arc;

use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb};

use super::{Picture, PlotError};

/// Pixels for each one of the picture's natural size, so that small text is legible on today's screens.
const DENSITY: f32 = 2.0;
const FAMILY: &str = "Noto Sans";

/// The picture as a PNG file.
pub(super) fn render(picture: &Picture) -> Result<Vec<u8>, PlotError> {
    let cannot = |error: &dyn std::fmt::Display| PlotError::Draw(error.to_string());
    let mut fonts = fontdb::Database::new();
    fonts.load_font_data(ttf_noto_sans::REGULAR.to_vec());
    fonts.load_font_data(ttf_noto_sans::BOLD.to_vec());
    fonts.set_sans_serif_family(FAMILY);
    let options = Options { fontdb: Arc::new(fonts), font_family: FAMILY.into(), ..Options::default() };
    let tree = Tree::from_str(picture.svg(), &options).map_err(|error| cannot(&error))?;
    let size = tree.size().to_int_size().scale_by(DENSITY);
    let mut pixels = size
        .and_then(|size| Pixmap::new(size.width(), size.height()))
        .ok_or_else(|| cannot(&"the picture has no room for pixels"))?;
    resvg::render(&tree, Transform::from_scale(DENSITY, DENSITY), &mut pixels.as_mut());
    pixels.encode_png().map_err(|error| cannot(&error))
}
