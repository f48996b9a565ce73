//! Paths as text. A path may hold bytes that are no UTF-8, which JSON and TOML cannot: they become `�`, as in messages.

use std::path::Path;

use serde::Serializer;

/// Serializes a path as text, for `#[serde(serialize_with)]`. serde's own way fails for what is no UTF-8.
///
/// # Errors
///
/// The serializer's.
pub fn serialize<S: Serializer>(path: impl AsRef<Path>, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&path.as_ref().to_string_lossy())
}

/// Serializes a path as text where there is one, for `#[serde(serialize_with)]`.
///
/// # Errors
///
/// The serializer's.
pub fn serialize_option<S: Serializer>(path: &Option<impl AsRef<Path>>, serializer: S) -> Result<S::Ok, S::Error> {
    match path {
        Some(path) => serializer.serialize_some(&path.as_ref().to_string_lossy()),
        None => serializer.serialize_none(),
    }
}
