//! The header of NumPy's file format, versions 1 to 3 (NumPy Enhancement Proposal 1), and the numbers behind it.

use std::io::{self, Read, Write};

/// Longer headers are damaged ones: those of arrays of numbers have some hundred bytes.
const MAX_HEADER: u64 = 1 << 20;

/// What an array's header says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Header {
    /// The type of its items as it is written in Python, as `'<f4'`.
    pub dtype: String,
    /// Whether the first axis is the fastest.
    pub fortran_order: bool,
    /// Lengths of the axes.
    pub shape: Vec<u64>,
}

/// A type of numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Number {
    /// What it is.
    pub kind: NumberKind,
    /// Bytes of each.
    pub size: usize,
    big_endian: bool,
}

/// Kinds of numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NumberKind {
    /// Floating-point, of 4 or 8 bytes.
    Float,
    /// Whole, of 1, 2, 4 or 8 bytes.
    Int,
    /// Whole and not negative, of 1, 2, 4 or 8 bytes.
    Uint,
}

impl Header {
    /// The header of an array in C order, of a type as `<f4`.
    pub fn new(dtype: &str, shape: &[usize]) -> Self {
        let shape = shape.iter().map(|&n| n as u64).collect();
        Self { dtype: format!("'{dtype}'"), fortran_order: false, shape }
    }

    /// Reads a header up to the first number.
    ///
    /// # Errors
    ///
    /// It is no such file, or a truncated one.
    pub fn read(mut r: impl Read) -> io::Result<Self> {
        let damaged = |reason: &str| io::Error::new(io::ErrorKind::InvalidData, reason.to_owned());
        let mut magic = [0; 8];
        exactly(&mut r, &mut magic)?;
        if &magic[..6] != b"\x93NUMPY" {
            return Err(damaged("it does not start with NUMPY"));
        }
        let length = if magic[6] == 1 {
            let mut bytes = [0; 2];
            exactly(&mut r, &mut bytes)?;
            u64::from(u16::from_le_bytes(bytes))
        } else {
            let mut bytes = [0; 4];
            exactly(&mut r, &mut bytes)?;
            u64::from(u32::from_le_bytes(bytes))
        };
        if length > MAX_HEADER {
            return Err(damaged("its header has an impossible length"));
        }
        let mut text = String::new();
        r.take(length).read_to_string(&mut text)?;
        if text.len() as u64 != length {
            return Err(damaged("it ends in its header"));
        }
        Self::parse(&text).ok_or_else(|| damaged("its header is not understood"))
    }

    /// Reads the header's text, a dictionary of Python with three known keys.
    fn parse(text: &str) -> Option<Self> {
        let mut rest = text.trim().strip_prefix('{')?.strip_suffix('}')?.trim();
        let (mut dtype, mut fortran_order, mut shape) = (None, None, None);
        while !rest.is_empty() {
            let quote = rest.chars().next().filter(|c| ['\'', '"'].contains(c))?;
            let (key, after) = rest[1..].split_once(quote)?;
            let after = after.trim_start().strip_prefix(':')?;
            let (value, after) = split_value(after);
            match key {
                "descr" => dtype = Some(value.to_owned()),
                "fortran_order" => fortran_order = Some(["False", "True"].iter().position(|v| *v == value)? == 1),
                "shape" => {
                    let axes = value.strip_prefix('(')?.strip_suffix(')')?.split(',').map(str::trim);
                    let axes: Result<Vec<u64>, _> = axes.filter(|n| !n.is_empty()).map(str::parse).collect();
                    shape = Some(axes.ok()?);
                }
                _ => return None,
            }
            rest = after.trim_start();
        }
        Some(Self { dtype: dtype?, fortran_order: fortran_order?, shape: shape? })
    }

    /// Writes the header; the array's bytes follow.
    ///
    /// # Errors
    ///
    /// It cannot be written.
    pub fn write(&self, w: &mut (impl Write + ?Sized)) -> io::Result<()> {
        let axes: String = self.shape.iter().map(|n| format!("{n}, ")).collect();
        let order = if self.fortran_order { "True" } else { "False" };
        let text = format!("{{'descr': {}, 'fortran_order': {order}, 'shape': ({axes}), }}", self.dtype);
        // Numbers begin at a multiple of 64 bytes; ten bytes stand before the text, and a line ends behind it.
        let length = (10 + text.len() + 1).next_multiple_of(64) - 10;
        let short = u16::try_from(length).map_err(|_| io::Error::other("too many axes for a .npy file"))?;
        w.write_all(b"\x93NUMPY\x01\x00")?;
        w.write_all(&short.to_le_bytes())?;
        writeln!(w, "{text:<width$}", width = length - 1)
    }

    /// The type of the items, if they are numbers of a common size.
    pub fn number(&self) -> Option<Number> {
        let text = self.dtype.strip_prefix(['\'', '"'])?.strip_suffix(['\'', '"'])?;
        let (big_endian, text) = match text.split_at_checked(1)? {
            (">", rest) => (true, rest),
            ("<" | "|" | "=", rest) => (false, rest),
            _ => (false, text),
        };
        let (kind, size) = text.split_at_checked(1)?;
        let size: usize = size.parse().ok()?;
        let kind = match kind {
            "f" if [4, 8].contains(&size) => NumberKind::Float,
            "i" if [1, 2, 4, 8].contains(&size) => NumberKind::Int,
            "u" if [1, 2, 4, 8].contains(&size) => NumberKind::Uint,
            _ => return None,
        };
        Some(Number { kind, size, big_endian })
    }

    /// Number of items; `None` for more than there can be.
    pub fn len(&self) -> Option<usize> {
        let n = self.shape.iter().try_fold(1u64, |n, &m| n.checked_mul(m))?;
        usize::try_from(n).ok()
    }

    /// Whether there is no item.
    pub fn is_empty(&self) -> bool {
        self.shape.contains(&0)
    }
}

/// Splits off a value of a Python dictionary, which ends at a comma outside of brackets and quotes.
fn split_value(text: &str) -> (&str, &str) {
    let (mut depth, mut quote) = (0usize, None);
    for (i, c) in text.char_indices() {
        match (quote, c) {
            (Some(open), _) if c == open => quote = None,
            (Some(_), _) => {}
            (None, '\'' | '"') => quote = Some(c),
            (None, '(' | '[' | '{') => depth += 1,
            (None, ')' | ']' | '}') => depth = depth.saturating_sub(1),
            (None, ',') if depth == 0 => return (text[..i].trim(), &text[i + 1..]),
            _ => {}
        }
    }
    (text.trim(), "")
}

/// Fills `bytes`. Of a file that ends before, Rust says that it "failed to fill whole buffer".
fn exactly(r: &mut impl Read, bytes: &mut [u8]) -> io::Result<()> {
    r.read_exact(bytes).map_err(|e| match e.kind() {
        io::ErrorKind::UnexpectedEof => io::Error::new(e.kind(), "it ends too early"),
        _ => e,
    })
}

impl Number {
    /// The bytes of the next number, least first.
    fn next(self, mut r: impl Read) -> io::Result<[u8; 8]> {
        let mut bytes = [0; 8];
        exactly(&mut r, &mut bytes[..self.size])?;
        if self.big_endian {
            bytes[..self.size].reverse();
        }
        Ok(bytes)
    }

    /// Reads the next floating-point number, rounded to `f32`.
    ///
    /// # Errors
    ///
    /// There is none.
    pub fn read_f32(self, r: impl Read) -> io::Result<f32> {
        let bytes = self.next(r)?;
        Ok(match self.size {
            4 => f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
            _ => f64::from_le_bytes(bytes) as f32,
        })
    }

    /// Reads the next whole number; -1 for one that is too large.
    ///
    /// # Errors
    ///
    /// There is none.
    pub fn read_i64(self, r: impl Read) -> io::Result<i64> {
        let bits = u64::from_le_bytes(self.next(r)?);
        let unused = 64 - 8 * self.size as u32;
        Ok(match self.kind {
            NumberKind::Uint => i64::try_from(bits).unwrap_or(-1),
            // The sign moves to where that of an i64 is, and back.
            _ => ((bits << unused) as i64) >> unused,
        })
    }
}
