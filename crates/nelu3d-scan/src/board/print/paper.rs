//! Sizes of paper.

/// A sheet of paper, upright: width and height, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Paper {
    /// Width and height, mm.
    pub size_mm: [f64; 2],
}

/// Names of sizes: ISO 216, and ANSI/ASME Y14.1 with inches of 25.4 mm.
const NAMED: [(&str, [f64; 2]); 9] = [
    ("a0", [841.0, 1189.0]),
    ("a1", [594.0, 841.0]),
    ("a2", [420.0, 594.0]),
    ("a3", [297.0, 420.0]),
    ("a4", [210.0, 297.0]),
    ("a5", [148.0, 210.0]),
    ("letter", [215.9, 279.4]),
    ("legal", [215.9, 355.6]),
    ("tabloid", [279.4, 431.8]),
];

impl Paper {
    /// ISO 216, A4.
    pub const A4: Paper = Paper { size_mm: [210.0, 297.0] };

    /// Returns the paper of a name, or of a width and a height as 210x297 (mm, up to 20 m); `None` for another text.
    pub fn from_name(text: &str) -> Option<Self> {
        if let Some((_, size_mm)) = NAMED.iter().find(|(name, _)| name.eq_ignore_ascii_case(text)) {
            return Some(Self { size_mm: *size_mm });
        }
        let (w, h) = text.split_once(['x', 'X', '×'])?;
        let size_mm = [w.trim().parse().ok()?, h.trim().parse().ok()?];
        size_mm.iter().all(|v: &f64| (1.0..=20_000.0).contains(v)).then_some(Self { size_mm })
    }

    /// Returns the names there are.
    pub fn names() -> impl Iterator<Item = &'static str> {
        NAMED.iter().map(|(name, _)| *name)
    }

    /// Returns the paper turned by a quarter.
    #[must_use]
    pub fn turned(self) -> Self {
        Self { size_mm: [self.size_mm[1], self.size_mm[0]] }
    }
}
