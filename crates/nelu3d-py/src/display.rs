//! How results show themselves in a notebook: offline, in a frame of their own, without a library of widgets.

use nelu3d_report::html::escape;

/// Returns a whole page as a frame inside another page.
pub(crate) fn frame(title: &str, page: &str, height_px: usize) -> String {
    format!(
        "<iframe title=\"{}\" srcdoc=\"{}\" style=\"width:100%;height:{height_px}px;border:0\"></iframe>",
        escape(title),
        escape(page)
    )
}
