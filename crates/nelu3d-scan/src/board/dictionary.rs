use calib_targets_aruco::{Dictionary as Codes, builtins};

use super::BoardError;

/// A predefined ArUco or AprilTag dictionary: for each id, a square of black and white bits inside a black border that
/// is one bit wide.
#[derive(Clone, Copy, Debug)]
pub struct Dictionary {
    codes: Codes,
}

impl Dictionary {
    /// Returns the dictionary OpenCV knows by this name, upper or lower case; fails with the list of names for any
    /// other.
    pub fn by_name(name: &str) -> Result<Self, BoardError> {
        let known = Self::names().iter().find(|n| n.eq_ignore_ascii_case(name));
        let codes = known.and_then(|n| builtins::builtin_dictionary(n));
        codes
            .map(|codes| Self { codes })
            .ok_or_else(|| BoardError::UnknownDictionary { name: name.to_owned(), known: Self::names() })
    }

    /// Returns OpenCV's names of all dictionaries there are.
    pub fn names() -> &'static [&'static str] {
        builtins::BUILTIN_DICTIONARY_NAMES
    }

    /// Returns the name of the dictionary.
    pub fn name(&self) -> &'static str {
        self.codes.name()
    }

    /// Returns the number of markers; ids are below it.
    #[allow(clippy::len_without_is_empty)] // no dictionary is empty
    pub fn len(&self) -> usize {
        self.codes.codes().len()
    }

    /// Returns the number of bits along a side, without the border.
    pub fn bits(&self) -> usize {
        self.codes.marker_size()
    }

    /// Returns whether the bit at this row and column (from the marker's own top-left, border not counted) of marker
    /// `id` is black. Panics outside the marker.
    pub fn is_black(&self, id: u32, row: usize, column: usize) -> bool {
        let n = self.bits();
        assert!(row < n && column < n, "bit ({row}, {column}) of a {n} x {n} marker");
        (self.codes.codes()[id as usize] >> (row * n + column)) & 1 == 1
    }

    pub(crate) fn codes(&self) -> Codes {
        self.codes
    }
}
