#![cfg(unix)]

use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;
use std::path::PathBuf;

use nelu3d_scan::path_text;

#[derive(serde::Serialize)]
struct Answer {
    #[serde(serialize_with = "path_text::serialize")]
    path: PathBuf,
    #[serde(serialize_with = "path_text::serialize_option")]
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
