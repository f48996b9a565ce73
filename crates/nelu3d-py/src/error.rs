//! Errors of the libraries as Python's exceptions, with the same sentence.

use pyo3::PyErr;
use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyUserWarning};

create_exception!(nelu3d, Error, PyException, "What went wrong, in one sentence: where, what, and what to do.");
create_exception!(
    nelu3d,
    Refused,
    Error,
    "A result was judged bad. Its attribute `result` has it; `accept=True` returns it all the same."
);
create_exception!(nelu3d, ScanWarning, PyUserWarning, "What speaks against a result, and what to do about it.");

/// Why work failed, in one sentence. Every error of the libraries becomes one by `?`.
pub(crate) struct Problem(pub(crate) String);

impl<E: std::error::Error + 'static> From<E> for Problem {
    fn from(error: E) -> Self {
        Self(sentence(&error))
    }
}

impl Problem {
    /// Returns the exception.
    pub(crate) fn exception(self) -> PyErr {
        Error::new_err(self.0)
    }
}

/// Returns the exception of an error.
pub(crate) fn exception(error: impl std::error::Error + 'static) -> PyErr {
    Problem::from(error).exception()
}

/// Returns an error and its causes as one sentence in one line. A cause that the sentence already says is not repeated.
fn sentence(error: &(dyn std::error::Error + 'static)) -> String {
    let mut text = String::new();
    let mut cause = Some(error);
    while let Some(error) = cause {
        let said = one_line(&error.to_string());
        if !text.contains(&said) {
            text += if text.is_empty() { "" } else { ": " };
            text += &said;
        }
        cause = error.source();
    }
    text
}

/// Returns the text without line breaks and other control characters.
fn one_line(text: &str) -> String {
    text.split(char::is_control).map(str::trim).filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" ")
}
