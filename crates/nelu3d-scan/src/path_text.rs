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

#[cfg(all(test, unix))]
mod tests {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;
    use std::path::PathBuf;

    #[derive(serde::Serialize)]
    struct Answer {
        #[serde(serialize_with = "super::serialize")]
        path: PathBuf,
        #[serde(serialize_with = "super::serialize_option")]
        other: Option<PathBuf>,
    }

    #[test]
    fn any_path_is_written() {
        let path = PathBuf::from(OsStr::from_bytes(b"a/b\xff"));
        for (other, text) in [(None, "null"), (Some(path.clone()), "\"a/b\u{fffd}\"")] {
            let json = serde_json::to_string(&Answer { path: path.clone(), other }).unwrap();
            assert_eq!(json, format!("{{\"path\":\"a/b\u{fffd}\",\"other\":{text}}}"));
        }
    }
}
