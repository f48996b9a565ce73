//! The frame of every page: title, look, and the one script that turns surfaces.

use super::html::{escape, fill};

const TEMPLATE: &str = include_str!("template.html");
pub(super) const STYLE: &str = include_str!("style.css");
pub(super) const VIEWER: &str = include_str!("viewer.js");

/// Returns a whole page: `title` and `subtitle` are text, `body` is HTML. It needs no other file and no network.
pub fn page(title: &str, subtitle: &str, body: &str) -> String {
    let parts = [
        ("title", escape(title)),
        ("subtitle", escape(subtitle)),
        ("style", STYLE.to_owned()),
        ("body", body.to_owned()),
        ("viewer", VIEWER.to_owned()),
    ];
    fill(TEMPLATE, &parts)
}

/// Returns a part of a page under a heading; `content` is HTML.
pub fn section(heading: &str, content: &str) -> String {
    format!("<section><h2>{}</h2>{content}</section>", escape(heading))
}

/// Returns a part of a page that folds away behind its heading, open at first if asked for.
pub fn details(heading: &str, open: bool, content: &str) -> String {
    let open = if open { " open" } else { "" };
    format!("<section><details{open}><summary>{}</summary>{content}</details></section>", escape(heading))
}
