//! Tables on disk, in the two formats of the LookUp3D tools.
//!
//! - `.npy`: height × width × positions × (k + 1) float32, depth last. A missing sample is NaN (in their tables, and in
//!   ours); a depth that is not positive counts as missing, too.
//! - `.npz`: `L_1`, `R_1` … `L_k`, `R_k` and `L_d`, `R_d`: entry = L R with L of (height · width) × rank and R of rank ×
//!   positions; `shape`: the shape of the table they stand for. Ours also holds `range` (uint16, (height · width) × 2: from,
//!   to): the positions that were seen at all, without which a low-rank table could not tell. Their tools ignore it, and
//!   without it every position counts.
//!
//! Arrays are read as they pass: float32 or float64 (rounded), of either byte order, in C or Fortran order, an `.npz`
//! compressed or not.

mod error;

use std::fs::File;
use std::io::{self, BufReader, Read, Write};
use std::path::Path;

use nelu3d_scan::input::{open_file, shortened};
use nelu3d_scan::npy::{Header, Number, NumberKind};
use nelu3d_scan::output::write_atomic;
use serde::Serialize;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use crate::lookup3d::full::FullTable;
use crate::lookup3d::low_rank::LowRank;
use crate::lookup3d::shape::{TableShape, free_memory};
use crate::lookup3d::table::Table;
pub use error::FileError;

/// Larger strides are taken for another camera's table: nearly any small picture would be every nth pixel of a large
/// one.
pub(crate) const MAX_STRIDE: usize = 16;
const AGAIN: &str = "export it again with `nelu3d table export`, or from numpy as float32";

/// What a table must fit.
#[derive(Clone, Copy, Debug)]
pub struct Expected {
    /// Width of the camera's pictures.
    pub width: usize,
    /// Height.
    pub height: usize,
    /// Channels of a codeword.
    pub k: usize,
}

/// Writes a table as `.npy`. Depths of missing samples are kept, their codewords are NaN.
///
/// # Errors
/// The file cannot be written.
pub fn write_npy(table: &FullTable, path: &Path) -> Result<(), FileError> {
    let s = table.shape;
    let per_pixel = s.n_positions * (s.k + 1);
    let value = |i: usize| {
        let (pixel, rest) = (i / per_pixel, i % per_pixel);
        table.channel(pixel, rest % (s.k + 1))[rest / (s.k + 1)]
    };
    let shape = [s.height, s.width, s.n_positions, s.k + 1];
    Ok(write_atomic(path, |w| {
        write_array(w, "<f4", &shape, (0..s.n_pixels() * per_pixel).map(value).map(f32::to_le_bytes))
    })?)
}

/// Writes a low-rank table as `.npz`.
///
/// # Errors
/// The file cannot be written.
pub fn write_npz(table: &LowRank, path: &Path) -> Result<(), FileError> {
    let s = table.shape;
    let (n, p, row_len, stride) = (s.n_pixels(), s.n_positions, table.row_len(), s.stride());
    Ok(write_atomic(path, |w| {
        let mut zip = ZipWriter::new_stream(w);
        for j in 0..=s.k {
            let at = j * table.rank;
            let (rank, name) = if j < s.k { (table.rank, (j + 1).to_string()) } else { (table.depth_rank, "d".into()) };
            let left = table.left.chunks_exact(row_len).flat_map(|row| &row[at..at + rank]).copied();
            start(&mut zip, &format!("L_{name}"))?;
            write_array(&mut zip, "<f4", &[n, rank], left.map(f32::to_le_bytes))?;
            let right = (0..rank * p).map(|i| match j < s.k {
                true => table.right[(at + i / p) * stride + i % p],
                false => table.right_depth[i],
            });
            start(&mut zip, &format!("R_{name}"))?;
            write_array(&mut zip, "<f4", &[rank, p], right.map(f32::to_le_bytes))?;
        }
        start(&mut zip, "shape")?;
        let sizes = [s.height, s.width, p, s.k + 1].map(|n| (n as i64).to_le_bytes());
        write_array(&mut zip, "<i8", &[4], sizes.into_iter())?;
        start(&mut zip, "range")?;
        let ranges = table.ranges.as_flattened().iter().map(|v| (*v as u16).to_le_bytes());
        write_array(&mut zip, "<u2", &[n, 2], ranges)?;
        zip.finish()?;
        Ok(())
    })?)
}

fn start(zip: &mut ZipWriter<impl Write + io::Seek>, name: &str) -> io::Result<()> {
    // Factors are noise to a compressor.
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored).large_file(true);
    Ok(zip.start_file(format!("{name}.npy"), options)?)
}

/// Writes an array in C order, its numbers as little-endian bytes.
fn write_array<const N: usize>(
    mut w: impl Write,
    dtype: &str,
    shape: &[usize],
    mut numbers: impl Iterator<Item = [u8; N]>,
) -> io::Result<()> {
    Header::new(dtype, shape).write(&mut w)?;
    let mut block = Vec::with_capacity(1 << 16);
    loop {
        block.clear();
        block.extend(numbers.by_ref().take((1 << 16) / N).flatten());
        if block.is_empty() {
            return Ok(());
        }
        w.write_all(&block)?;
    }
}

/// An array that is read as it passes.
struct Stream<R> {
    header: Header,
    numbers: R,
}

impl<R: Read> Stream<R> {
    fn new(mut numbers: R) -> io::Result<Self> {
        Ok(Self { header: Header::read(&mut numbers)?, numbers })
    }
}

/// What a file says about itself.
#[derive(Clone, Debug, Serialize)]
pub struct Info {
    /// "full" or "low-rank".
    pub kind: &'static str,
    /// Pixels of a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Board positions.
    pub positions: usize,
    /// Channels of a codeword.
    pub channels: usize,
    /// Terms per channel of a low-rank table.
    pub rank: Option<usize>,
    /// Terms of its depth.
    pub depth_rank: Option<usize>,
    /// Share of the samples that are missing.
    pub missing: f64,
    /// Nearest and farthest depth of a sample, mm; none if there is no sample.
    pub depth_mm: Option<[f32; 2]>,
    /// Size of the file.
    pub bytes: u64,
}

/// Reads a table's file and describes it.
///
/// # Errors
/// As [`read`].
pub fn info(path: &Path) -> Result<Info, FileError> {
    let bytes = std::fs::metadata(path).map_err(|source| FileError::Io { path: path.into(), source })?.len();
    let table = read(path, None)?;
    let s = *table.shape();
    let (mut missing, mut near, mut far) = (0usize, f32::INFINITY, f32::NEG_INFINITY);
    for pixel in 0..s.n_pixels() {
        for position in 0..s.n_positions {
            let z = table.depth(pixel, position);
            missing += usize::from(z.is_nan());
            (near, far) = (near.min(z), far.max(z));
        }
    }
    let (kind, rank, depth_rank) = match &table {
        Table::Full(_) => ("full", None, None),
        Table::LowRank(t) => ("low-rank", Some(t.rank), Some(t.depth_rank)),
    };
    Ok(Info {
        kind,
        width: s.width,
        height: s.height,
        positions: s.n_positions,
        channels: s.k,
        rank,
        depth_rank,
        missing: missing as f64 / (s.n_pixels() * s.n_positions) as f64,
        depth_mm: (near <= far).then_some([near, far]),
        bytes,
    })
}

/// Reads a table of either kind. With `expected`, it must be of that camera (or of every nth of its pixels) and pattern
/// set.
///
/// # Errors
/// The file cannot be read, is no table, does not fit what is expected, or does not fit in memory.
pub fn read(path: &Path, expected: Option<Expected>) -> Result<Table, FileError> {
    let reader = Reader { path, expected };
    let (file, size) = open_file(path).map_err(|source| FileError::Io { path: path.into(), source })?;
    let mut file = BufReader::with_capacity(1 << 20, file);
    let mut magic = [0; 2];
    file.read_exact(&mut magic).map_err(|e| reader.malformed(shortened(&e.to_string())))?;
    io::Seek::rewind(&mut file).map_err(|source| FileError::Io { path: path.into(), source })?;
    if &magic == b"PK" { reader.npz(file) } else { reader.npy(file, size) }
}

struct Reader<'a> {
    path: &'a Path,
    expected: Option<Expected>,
}

impl Reader<'_> {
    fn malformed(&self, reason: impl Into<String>) -> FileError {
        FileError::Malformed { path: self.path.into(), reason: reason.into(), remedy: AGAIN }
    }

    /// The shape behind the four numbers of a table, if it is possible and what is expected.
    fn shape(&self, sizes: &[u64], memory: impl Fn(&TableShape) -> usize) -> Result<TableShape, FileError> {
        const MAX_SIZE: u64 = 1 << 20;
        let [height, width, n_positions, channels] = match *sizes {
            [a, b, c, d] if sizes.iter().all(|n| (1..MAX_SIZE).contains(n)) && d > 1 && c < 1 << 16 => {
                [a, b, c, d].map(|n| n as usize)
            }
            _ => {
                let reason = format!("its shape is {sizes:?}, not height × width × positions × (k + 1)");
                return Err(self.malformed(reason));
            }
        };
        let mut shape = TableShape { width, height, step: 1, n_positions, k: channels - 1 };
        if let Some(e) = self.expected {
            let fits = |s: &usize| e.width.div_ceil(*s) == width && e.height.div_ceil(*s) == height;
            // Of strides that give the same size the one that ends closest to the border.
            match (1..=MAX_STRIDE).find(fits).filter(|_| e.k == shape.k) {
                Some(step) => shape.step = step,
                None => {
                    return Err(FileError::Other {
                        path: self.path.into(),
                        found: format!("{width} × {height} pixels and {} channels", shape.k),
                        wanted: format!("{} × {} pixels and {} channels", e.width, e.height, e.k),
                    });
                }
            }
        }
        let needed = memory(&shape) as f64;
        if let Some(free) = free_memory()
            && needed > free
        {
            let mb = |bytes: f64| (bytes / 1e6).round() as u64;
            return Err(FileError::Memory { path: self.path.into(), needed_mb: mb(needed), free_mb: mb(free) });
        }
        Ok(shape)
    }

    /// Calls `f(index, value)` for every float of an array, indices in C order.
    fn floats<R: Read>(&self, file: Stream<R>, mut f: impl FnMut(usize, f32)) -> Result<(), FileError> {
        let Stream { header, mut numbers } = file;
        let shape: Vec<usize> = header.shape.iter().map(|n| *n as usize).collect();
        let n: usize = shape.iter().product();
        let fortran = header.fortran_order;
        let mut index = vec![0usize; shape.len()];
        // Stored first axis first: the place of each value is counted along.
        let mut place = |i: usize| {
            if !fortran {
                return i;
            }
            let at = index.iter().zip(&shape).fold(0, |at, (i, n)| at * n + i);
            for (i, n) in index.iter_mut().zip(&shape) {
                *i += 1;
                if *i < *n {
                    break;
                }
                *i = 0;
            }
            at
        };
        let number = match header.number() {
            Some(number) if number.kind == NumberKind::Float => number,
            _ => {
                let reason = format!("it holds {} values, not floats of 32 or 64 bits", header.dtype);
                return Err(self.malformed(reason));
            }
        };
        for count in 0..n {
            let v = number.read_f32(&mut numbers);
            let v = v.map_err(|e| self.malformed(format!("it ends after {count} of {n} values: {e}")))?;
            f(place(count), v);
        }
        Ok(())
    }

    fn npy(&self, file: impl Read, size: u64) -> Result<Table, FileError> {
        let file = Stream::new(file).map_err(|e| self.malformed(e.to_string()))?;
        let shape = self.shape(&file.header.shape, TableShape::bytes)?;
        let TableShape { n_positions, k, .. } = shape;
        // A damaged header must not make us ask for all memory there is.
        if (shape.n_pixels() * n_positions * (k + 1)) as u64 * 4 > size {
            return Err(self.malformed(format!("it has fewer values than its shape {:?} says", file.header.shape)));
        }
        let mut table = FullTable::empty(shape);
        let per_pixel = n_positions * (k + 1);
        self.floats(file, |i, v| {
            let (pixel, rest) = (i / per_pixel, i % per_pixel);
            table.put(pixel, rest % (k + 1), rest / (k + 1), v);
        })?;
        table.close();
        Ok(Table::Full(table))
    }

    fn npz(&self, file: BufReader<File>) -> Result<Table, FileError> {
        let mut zip = ZipArchive::new(file).map_err(|e| self.malformed(e.to_string()))?;
        let sizes = {
            let file = self.entry(&mut zip, "shape")?;
            if file.header.len() != Some(4) {
                return Err(self.malformed("its array `shape` does not hold four numbers"));
            }
            self.integers(file)?
        };
        // The ranks are in the headers of the factors.
        let k = usize::try_from(sizes[3]).unwrap_or(0).saturating_sub(1);
        let names: Vec<String> =
            (1..=k.min(zip.len())).map(|j| j.to_string()).chain(std::iter::once("d".into())).collect();
        let mut ranks = Vec::new();
        for name in &names {
            let file = self.entry(&mut zip, &format!("R_{name}"))?;
            ranks.push(match *file.header.shape {
                [r, p] if p == sizes[2] && (1..=p).contains(&r) => r as usize,
                ref found => {
                    return Err(self.malformed(format!("R_{name} is {found:?}, not rank × {} positions", sizes[2])));
                }
            });
        }
        let depth_rank = ranks.pop().unwrap_or(1);
        let rank = ranks.iter().copied().max().unwrap_or(1);
        let memory =
            |s: &TableShape| s.n_pixels().saturating_mul(s.k * rank + depth_rank + 2).saturating_mul(size_of::<f32>());
        let shape = self.shape(&sizes, memory)?;
        let (n, p, stride) = (shape.n_pixels(), shape.n_positions, shape.stride());
        ranks.push(depth_rank);
        for (name, r) in names.iter().zip(&ranks) {
            let file = self.entry(&mut zip, &format!("L_{name}"))?;
            if *file.header.shape != [n as u64, *r as u64] {
                let reason = format!("L_{name} is {:?}, not {n} pixels × rank {r}", file.header.shape);
                return Err(self.malformed(reason));
            }
        }
        let mut table = LowRank::zeros(shape, rank, depth_rank);
        let row_len = table.row_len();
        let mut finite = true;
        for (j, (name, r)) in names.iter().zip(&ranks).enumerate() {
            let file = self.entry(&mut zip, &format!("L_{name}"))?;
            self.floats(file, |i, v| {
                finite &= v.is_finite();
                table.left[i / r * row_len + j * rank + i % r] = v;
            })?;
            let file = self.entry(&mut zip, &format!("R_{name}"))?;
            self.floats(file, |i, v| {
                finite &= v.is_finite();
                if j < shape.k {
                    table.right[(j * rank + i / p) * stride + i % p] = v;
                } else {
                    table.right_depth[i] = v;
                }
            })?;
        }
        if !finite {
            return Err(self.malformed("its factors are not all finite"));
        }
        let has_ranges = zip.index_for_name("range.npy").is_some();
        if has_ranges {
            let file = self.entry(&mut zip, "range")?;
            let ranges = if *file.header.shape == [n as u64, 2] { self.integers(file)? } else { Vec::new() };
            let good =
                ranges.len() == 2 * n && ranges.as_chunks::<2>().0.iter().all(|r| r[0] <= r[1] && r[1] <= p as u64);
            if !good {
                return Err(self.malformed("its array `range` does not fit its shape"));
            }
            table.ranges = ranges.as_chunks::<2>().0.iter().map(|r| r.map(|v| v as u32)).collect();
        }
        Ok(Table::LowRank(table))
    }

    fn entry<'z>(
        &self,
        zip: &'z mut ZipArchive<BufReader<File>>,
        name: &str,
    ) -> Result<Stream<impl Read + use<'z>>, FileError> {
        let file = zip
            .by_name(&format!("{name}.npy"))
            .map_err(|_| self.malformed(format!("it has no array `{name}`, or one that cannot be unpacked")))?;
        Stream::new(BufReader::with_capacity(1 << 16, file)).map_err(|e| self.malformed(format!("{name}: {e}")))
    }

    /// Whole numbers that are not negative, of any integer type, in C order.
    fn integers<R: Read>(&self, file: Stream<R>) -> Result<Vec<u64>, FileError> {
        let Stream { header, mut numbers } = file;
        let number: Number = match header.number() {
            Some(number) if number.kind != NumberKind::Float => number,
            _ => return Err(self.malformed(format!("it holds {} where whole numbers should be", header.dtype))),
        };
        let n: usize = header.shape.iter().map(|n| *n as usize).product();
        let values: io::Result<Vec<i64>> = (0..n).map(|_| number.read_i64(&mut numbers)).collect();
        let values = values.map_err(|e| self.malformed(e.to_string()))?;
        let ordered = !header.fortran_order || header.shape.len() < 2;
        if !ordered || values.iter().any(|v| *v < 0) {
            return Err(self.malformed("its `shape` or `range` makes no sense"));
        }
        Ok(values.into_iter().map(|v| v as u64).collect())
    }
}
