//! A camera file parsed to a tree of values, and typed access to it with errors that name file and key.

use std::path::{Path, PathBuf};

use serde_yaml_ng::Value;

use super::error::CameraFileError;
use crate::input::{MAX_TEXT, read_file};

/// A parsed JSON or YAML file. Both are held as YAML values, which can also hold NaN and infinity.
pub(super) struct Source {
    path: PathBuf,
    root: Value,
}

impl Source {
    /// Reads and parses a file.
    pub(super) fn read(path: &Path) -> Result<Self, CameraFileError> {
        let bytes =
            read_file(path, MAX_TEXT).map_err(|source| CameraFileError::Io { path: path.to_path_buf(), source })?;
        Self::parse(path, &bytes)
    }

    /// Parses the content of a file; `path` is for messages.
    pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Self, CameraFileError> {
        let syntax = |format, reason| CameraFileError::Syntax { path: path.to_path_buf(), format, reason };
        let text = std::str::from_utf8(bytes).map_err(|e| syntax("text", e.to_string()))?;
        // The YAML parser takes time that grows with the square of the depth: minutes for a file of brackets.
        if text.len() > MAX_BYTES || depth(text) > MAX_DEPTH {
            return Err(syntax("JSON or YAML", "it is too large or nested too deeply for a camera file".into()));
        }
        let root: Value = if text.trim_start().starts_with('{') {
            // Python and OpenCV write `NaN`, `.Nan` and `1.` into what they call JSON: YAML allows that, so that the
            // error can name the key instead of a line.
            serde_json::from_str(text)
                .or_else(|e| serde_yaml_ng::from_str(text).map_err(|_| syntax("JSON", e.to_string())))?
        } else {
            serde_yaml_ng::from_str(&plain_yaml(text)).map_err(|e| syntax("YAML", e.to_string()))?
        };
        let source = Self { path: path.to_path_buf(), root };
        if !source.root.is_mapping() {
            return Err(source.missing("K", "a camera file holds named values, as resx, resy, K, dist_coeffs"));
        }
        Ok(source)
    }

    pub(super) fn missing(&self, key: &str, remedy: &str) -> CameraFileError {
        CameraFileError::Missing { path: self.path.clone(), key: key.into(), remedy: remedy.into() }
    }

    pub(super) fn invalid(&self, key: &str, problem: impl Into<String>, remedy: &str) -> CameraFileError {
        CameraFileError::Invalid {
            path: self.path.clone(),
            key: key.into(),
            problem: problem.into(),
            remedy: remedy.into(),
        }
    }

    pub(super) fn has(&self, key: &str) -> bool {
        self.root.get(key).is_some_and(|v| !v.is_null())
    }

    /// Returns the value of a key that must be there.
    pub(super) fn value(&self, key: &str) -> Result<&Value, CameraFileError> {
        self.root.get(key).filter(|v| !v.is_null()).ok_or_else(|| self.missing(key, "add it"))
    }

    /// Returns a size under a key: a whole number of pixels.
    pub(super) fn size(&self, key: &str) -> Result<(String, usize), CameraFileError> {
        let value = self.value(key)?;
        // Some tools write sizes as floats (640.0).
        let whole =
            value.as_u64().or_else(|| value.as_f64().filter(|f| f.fract() == 0.0 && *f >= 0.0).map(|f| f as u64));
        let n = whole.ok_or_else(|| self.invalid(key, "is not a whole number", "give the image size in pixels"))?;
        Ok((key.into(), n as usize))
    }

    /// Returns all numbers under a key, whatever lists they are nested in, row by row.
    pub(super) fn numbers(&self, key: &str) -> Result<(String, Vec<f64>), CameraFileError> {
        Ok((key.into(), self.flatten(key, self.value(key)?)?))
    }

    /// Returns the numbers of `value`, whatever lists they are nested in.
    pub(super) fn flatten(&self, key: &str, value: &Value) -> Result<Vec<f64>, CameraFileError> {
        match value {
            Value::Sequence(items) => {
                let mut all = Vec::new();
                for item in items {
                    all.extend(self.flatten(key, item)?);
                }
                Ok(all)
            }
            Value::Number(n) => Ok(vec![n.as_f64().unwrap_or(f64::NAN)]),
            Value::String(s) => match s.to_ascii_lowercase().as_str() {
                ".nan" | "-.nan" | "nan" => Ok(vec![f64::NAN]),
                ".inf" | "infinity" => Ok(vec![f64::INFINITY]),
                "-.inf" | "-infinity" => Ok(vec![f64::NEG_INFINITY]),
                _ => Err(self.invalid(key, format!("holds \"{s}\""), "give numbers only")),
            },
            Value::Null => Err(self.invalid(key, "holds null", "give numbers only")),
            other => Err(self.invalid(key, format!("holds {other:?}"), "give numbers only")),
        }
    }
}

/// A camera file takes a few kilobytes; tools that add the corners of every image may write much more.
const MAX_BYTES: usize = 4 << 20;

/// As deep as a JSON parser goes.
const MAX_DEPTH: usize = 100;

/// Returns how deep brackets, or the dashes of a list within a line, are nested, at most.
fn depth(text: &str) -> usize {
    let (mut open, mut deepest) = (0usize, 0);
    for line in text.lines() {
        deepest = deepest.max(line.split_whitespace().take_while(|word| matches!(*word, "-" | "?")).count());
        for byte in line.bytes() {
            match byte {
                b'[' | b'{' => open += 1,
                b']' | b'}' => open = open.saturating_sub(1),
                _ => {}
            }
            deepest = deepest.max(open);
        }
    }
    deepest
}

/// Returns OpenCV's YAML without what makes it no YAML: its `%YAML:1.0` header and its type tags.
fn plain_yaml(text: &str) -> String {
    let lines = text.trim_start_matches('\u{feff}').lines().filter(|l| !l.starts_with("%YAML"));
    lines.map(|l| l.replace("!!opencv-matrix", "")).collect::<Vec<_>>().join("\n")
}
