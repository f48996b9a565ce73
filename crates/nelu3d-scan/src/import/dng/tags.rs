//! Tags of TIFF directories, through the `tiff` crate.

use std::io::Cursor;

use ::tiff::decoder::Decoder;
use ::tiff::decoder::ifd::Value;
use ::tiff::tags::{IfdPointer, Tag};

pub(super) use ::tiff::Directory;

pub(super) const NEW_SUBFILE_TYPE: u16 = 254;
pub(super) const WIDTH: u16 = 256;
pub(super) const HEIGHT: u16 = 257;
pub(super) const BITS_PER_SAMPLE: u16 = 258;
pub(super) const COMPRESSION: u16 = 259;
pub(super) const PHOTOMETRIC: u16 = 262;
pub(super) const STRIP_OFFSETS: u16 = 273;
pub(super) const SAMPLES_PER_PIXEL: u16 = 277;
pub(super) const ROWS_PER_STRIP: u16 = 278;
pub(super) const STRIP_BYTE_COUNTS: u16 = 279;
pub(super) const TILE_WIDTH: u16 = 322;
pub(super) const TILE_HEIGHT: u16 = 323;
pub(super) const TILE_OFFSETS: u16 = 324;
pub(super) const TILE_BYTE_COUNTS: u16 = 325;
const SUB_IFDS: u16 = 330;
pub(super) const CFA_REPEAT: u16 = 33421;
pub(super) const CFA_PATTERN: u16 = 33422;
pub(super) const LINEARIZATION_TABLE: u16 = 50712;
pub(super) const BLACK_LEVEL: u16 = 50714;
pub(super) const WHITE_LEVEL: u16 = 50717;
pub(super) const ACTIVE_AREA: u16 = 50829;

/// More directories than any camera writes.
const MAX_CHILDREN: usize = 16;

/// A file whose tags are read.
pub(super) struct Tags {
    decoder: Decoder<Cursor<Vec<u8>>>,
    first: u64,
    len: usize,
}

impl Tags {
    /// Opens a file. The crate decodes the first image's description at once and refuses one with a color filter: it is
    /// shown another one first, appended here: a gray pixel.
    pub(super) fn new(mut bytes: Vec<u8>) -> Result<Self, String> {
        let big = bytes.starts_with(b"MM");
        let header: [u8; 4] = bytes.get(4..8).and_then(|b| b.try_into().ok()).ok_or("it ends in its header")?;
        let first = if big { u32::from_be_bytes(header) } else { u32::from_le_bytes(header) };
        let len = bytes.len();
        bytes.resize(len.next_multiple_of(2), 0);
        let offset = u32::try_from(bytes.len()).map_err(|_| "it is larger than 4 GiB")?;
        bytes[4..8].copy_from_slice(&if big { offset.to_be_bytes() } else { offset.to_le_bytes() });
        let entries = [WIDTH, HEIGHT, PHOTOMETRIC, STRIP_OFFSETS, STRIP_BYTE_COUNTS];
        // The number of entries; each is tag, type (3: 16 bits), count (1, 32 bits), value (1, in the first two of four
        // bytes); no next directory.
        let mut words = vec![entries.len() as u16];
        for tag in entries {
            words.extend(if big { [tag, 3, 0, 1, 1, 0] } else { [tag, 3, 1, 0, 1, 0] });
        }
        words.extend([0, 0]);
        bytes.extend(words.into_iter().flat_map(|w| if big { w.to_be_bytes() } else { w.to_le_bytes() }));
        let decoder = Decoder::new(Cursor::new(bytes)).map_err(|e| e.to_string())?;
        Ok(Self { decoder, first: u64::from(first), len })
    }

    /// Returns the file, as it was given.
    pub(super) fn bytes(&mut self) -> &[u8] {
        &self.decoder.inner().get_ref()[..self.len]
    }

    /// Returns the file's first directory.
    pub(super) fn first(&mut self) -> Result<Directory, String> {
        self.decoder.read_directory(IfdPointer(self.first)).map_err(|e| e.to_string())
    }

    /// Returns the directories that hang from one.
    pub(super) fn children(&mut self, dir: &Directory) -> Result<Vec<Directory>, String> {
        let Some(value) = self.value(dir, SUB_IFDS)? else { return Ok(Vec::new()) };
        let pointers = value.into_ifd_vec().map_err(|e| e.to_string())?;
        let read = |p| self.decoder.read_directory(p).map_err(|e| e.to_string());
        pointers.into_iter().take(MAX_CHILDREN).map(read).collect()
    }

    /// Returns the value of a tag that has one whole number, or the first of several.
    pub(super) fn number(&mut self, dir: &Directory, tag: u16) -> Result<Option<u64>, String> {
        let first = self.numbers(dir, tag)?.first().copied();
        Ok(first.map(|v| v as u64))
    }

    /// Returns all numbers of a tag; none if there is no such tag. Those of more than 2⁵³ lose digits, which no file
    /// can reach.
    pub(super) fn numbers(&mut self, dir: &Directory, tag: u16) -> Result<Vec<f64>, String> {
        let Some(value) = self.value(dir, tag)? else { return Ok(Vec::new()) };
        let values = match value {
            Value::List(values) => values,
            one => vec![one],
        };
        values.iter().map(|v| number(v).ok_or_else(|| format!("its tag {tag} holds no numbers"))).collect()
    }

    fn value(&mut self, dir: &Directory, tag: u16) -> Result<Option<Value>, String> {
        self.decoder.read_directory_tags(dir).find_tag(Tag::from_u16_exhaustive(tag)).map_err(|e| e.to_string())
    }
}

fn number(value: &Value) -> Option<f64> {
    Some(match *value {
        Value::Byte(v) => v.into(),
        Value::Short(v) => v.into(),
        Value::SignedByte(v) => v.into(),
        Value::SignedShort(v) => v.into(),
        Value::Signed(v) => v.into(),
        Value::Unsigned(v) | Value::Ifd(v) => v.into(),
        Value::Float(v) => v.into(),
        Value::Double(v) => v,
        Value::Rational(a, b) => f64::from(a) / f64::from(b),
        Value::SRational(a, b) => f64::from(a) / f64::from(b),
        _ => return None,
    })
}
