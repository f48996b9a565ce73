//! The form for GPUs. The image is cut into slabs of rows, so that each slab's costs fit into a buffer; paths that go
//! on in the next slab carry their costs over.

use super::hypotheses::HypothesisLine;
use super::problem::{DIRECTIONS, NEAR, OUTSIDE, Problem, Winner};
use crate::device::DeviceError;
use crate::gpu::Gpu;
use crate::gpu::program::{Buffer, Constants, FOLD, Kernels, PLACE, folded};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Threads that share the hypotheses of a path.
const PATH_THREADS: usize = 128;
/// Threads that share the hypotheses of a pixel.
const WINNER_THREADS: usize = 64;
/// Threads of a workgroup for single hypotheses.
const HYPOTHESIS_THREADS: usize = 256;
/// Bytes that a workgroup shares.
const SHARED_BYTES: usize = 16 << 10;
/// The most hypotheses of which a workgroup can hold two rows, with walls at their ends.
const MAX_HYPOTHESES: usize = (SHARED_BYTES / 4 - PATH_THREADS - 16) / 2 - 2;

/// Rows of the image that are worked on together, and the pixels in them.
#[derive(Clone, Debug, PartialEq)]
pub struct Slab {
    rows: Range<usize>,
    /// The range of [`Problem::pixels`] that lies in the rows.
    pixels: Range<usize>,
}

/// Cuts the image so that no buffer of a slab is larger than `max_bytes`; `device` is its name in errors.
///
/// # Errors
///
/// A single row does not fit.
pub fn slabs(problem: &Problem<'_>, device: &str, max_bytes: u64) -> Result<Vec<Slab>, DeviceError> {
    let groups = problem.lattice.k.div_ceil(4);
    let pixel_bytes = (4 * problem.hypotheses.count).max(3 * 16 * groups).max(32) as u64;
    let row_bytes = 4 * problem.width as u64;
    let mut slabs: Vec<Slab> = Vec::new();
    let mut end = 0;
    for y in 0..problem.height {
        let begin = end;
        end += problem.pixels[begin..].partition_point(|i| (*i as usize) < (y + 1) * problem.width);
        let fits = |rows: usize, pixels: usize| {
            rows as u64 * row_bytes <= max_bytes && pixels as u64 * pixel_bytes <= max_bytes
        };
        if !fits(1, end - begin) {
            let what = "a row of the cost volume".into();
            let needed = row_bytes.max((end - begin) as u64 * pixel_bytes);
            return Err(DeviceError::Memory { device: device.to_owned(), what, needed, max: max_bytes });
        }
        match slabs.last_mut().filter(|s| fits(s.rows.len() + 1, end - s.pixels.start)) {
            Some(slab) => (slab.rows.end, slab.pixels.end) = (y + 1, end),
            None => slabs.push(Slab { rows: y..y + 1, pixels: begin..end }),
        }
    }
    Ok(slabs)
}

/// A slab on the device.
struct Loaded {
    slab: Slab,
    /// Slot in the cost volume of each pixel of its rows.
    slots: Buffer<u32>,
    /// 1 for each pixel with a hypothesis inside.
    seen: Buffer<u32>,
    costs: Buffer,
    sums: Buffer,
}

/// Copies channels in groups of four, filled up with zeros.
fn grouped(from: &[f32], k: usize, to: &mut [f32]) {
    let wide = 4 * k.div_ceil(4);
    for (to, from) in to.chunks_exact_mut(wide).zip(from.chunks_exact(k)) {
        to[..k].copy_from_slice(from);
    }
}

/// Uploads the lattice's nodes, in groups of four channels.
fn nodes(gpu: &Gpu, problem: &Problem<'_>) -> Result<Buffer, DeviceError> {
    let (nodes, k) = (problem.lattice.nodes, problem.lattice.k);
    if k.is_multiple_of(4) {
        return gpu.upload("the lattice", nodes);
    }
    const BLOCK: usize = 1 << 14;
    let wide = 4 * k.div_ceil(4);
    let mut padded = vec![0.0; nodes.len() / k * wide];
    padded.par_chunks_mut(BLOCK * wide).zip(nodes.par_chunks(BLOCK * k)).for_each(|(to, from)| grouped(from, k, to));
    gpu.upload("the lattice", &padded)
}

/// Uploads which cells are lit, one bit a cell.
fn lit(gpu: &Gpu, problem: &Problem<'_>) -> Result<Buffer<u32>, DeviceError> {
    let word = |cells: &[u8]| cells.iter().enumerate().fold(0, |word, (i, lit)| word | u32::from(*lit == 1) << i);
    gpu.upload("the lit cells", &problem.lit.lit.chunks(32).map(word).collect::<Vec<_>>())
}

/// Returns a line as the shader reads it.
fn packed(line: &HypothesisLine) -> [f32; 8] {
    let HypothesisLine { origin: [x, y, z], at, slope: [dx, dy, dz], bend, .. } = *line;
    [x, y, z, at, dx, dy, dz, bend]
}

/// A problem on a device.
struct Solver<'a> {
    gpu: &'a Gpu,
    problem: &'a Problem<'a>,
    kernels: Kernels,
}

impl Solver<'_> {
    /// Uploads a slab and computes its costs.
    fn load(&mut self, slab: Slab, nodes: &Buffer, lit: &Buffer<u32>) -> Result<Loaded, DeviceError> {
        let (gpu, problem) = (self.gpu, self.problem);
        let (k, n) = (problem.lattice.k, slab.pixels.len());
        let groups = k.div_ceil(4);
        let count = n * problem.hypotheses.count;
        let constants = Constants::default().count("GROUPS", groups).count("FOLD", FOLD);
        let kernel = self.kernels.get("costs", include_str!("costs.wgsl"), &constants)?;

        let pixels = &problem.pixels[slab.pixels.clone()];
        let mut codewords = vec![0.0; n * 12 * groups];
        codewords.par_chunks_mut(12 * groups).zip(pixels).for_each(|(to, pixel)| {
            let at = *pixel as usize * k..(*pixel as usize + 1) * k;
            for (from, to) in [problem.p, problem.inv_var, problem.surround].iter().zip(to.chunks_exact_mut(4 * groups))
            {
                grouped(&from[at.clone()], k, to);
            }
        });
        let line = |pixel: &u32| problem.rays.ray(*pixel).line(&problem.frame, problem.center, &problem.hypotheses);
        let (lines, ranges): (Vec<[f32; 8]>, Vec<[u32; 2]>) =
            pixels.par_iter().map(line).map(|line| (packed(&line), line.range)).unzip();
        let mut slots = vec![u32::MAX; slab.rows.len() * problem.width];
        for (slot, pixel) in pixels.iter().enumerate() {
            slots[*pixel as usize - slab.rows.start * problem.width] = slot as u32;
        }
        let [cells, lit_cells] = [problem.lattice.cells, problem.lit.cells].map(|c| c.map(|c| c as u32));
        let about = [
            [cells[0], cells[1], cells[2], problem.hypotheses.count as u32],
            [lit_cells[0], lit_cells[1], lit_cells[2], count as u32],
            [problem.prior[0], problem.prior[1], problem.saturation, OUTSIDE].map(f32::to_bits),
        ];

        let about = gpu.upload("sizes", &about)?;
        let codewords = gpu.upload("the codewords", &codewords)?;
        let (lines, ranges) = (gpu.upload("the rays", &lines)?, gpu.upload("the hypotheses of the rays", &ranges)?);
        let loaded = Loaded {
            slots: gpu.upload("the pixels", &slots)?,
            seen: gpu.zeros("the pixels inside", n)?,
            costs: gpu.zeros("the cost volume", count)?,
            sums: gpu.zeros("the sums of paths", count)?,
            slab,
        };
        let (costs, seen) = (&loaded.costs, &loaded.seen);
        let call = self.kernels.call(
            &kernel,
            folded(count, HYPOTHESIS_THREADS),
            &[&about, &lines, &ranges, &codewords, nodes, lit, costs, seen],
        )?;
        gpu.submit(&[&[call]])?;
        gpu.wait()?;
        Ok(loaded)
    }

    /// Adds the path costs of direction number `d` to the sums of all slabs.
    fn walk(&mut self, d: usize, slabs: &[Loaded], carry: &Buffer) -> Result<(), DeviceError> {
        let (gpu, problem) = (self.gpu, self.problem);
        let (width, height, count) = (problem.width, problem.height, problem.hypotheses.count);
        // A kernel for 300 hypotheses does for 301.
        let capacity = count.next_multiple_of(256).min(MAX_HYPOTHESES);
        let constants =
            Constants::default().count("CAPACITY", capacity).count("THREADS", PATH_THREADS).count("FOLD", FOLD);
        let kernel = self.kernels.get("paths", &[PLACE, include_str!("paths.wgsl")].concat(), &constants)?;
        let direction = DIRECTIONS[d];
        let ordered: Vec<&Loaded> =
            if direction[1] < 0 { slabs.iter().rev().collect() } else { slabs.iter().collect() };
        for s in ordered {
            let rows = &s.slab.rows;
            let lines = match direction {
                [_, 0] => rows.len(),
                [0, _] => width,
                _ => width + height - 1,
            };
            let number = |v: usize| v as u32;
            let about = [
                [direction[0] as u32, direction[1] as u32, number(width), number(height)],
                [number(rows.start), number(rows.len()), number(lines), number(count)],
                [problem.step.to_bits(), problem.jump.to_bits(), u32::from(d == 0), 0],
            ];
            let about = gpu.upload("sizes", &about)?;
            let call =
                self.kernels.call(&kernel, folded(lines, 1), &[&about, &s.slots, &s.seen, &s.costs, &s.sums, carry])?;
            gpu.submit(&[&[call]])?;
        }
        gpu.wait()
    }

    /// Appends the winners of a slab to `out`.
    fn choose(&mut self, loaded: &Loaded, out: &mut Vec<Winner>) -> Result<(), DeviceError> {
        let (gpu, n) = (self.gpu, loaded.slab.pixels.len());
        let constants = Constants::default().count("THREADS", WINNER_THREADS).count("NEAR", NEAR).count("FOLD", FOLD);
        let kernel = self.kernels.get("winners", &[PLACE, include_str!("winners.wgsl")].concat(), &constants)?;
        let about = gpu.upload("sizes", &[n as u32, self.problem.hypotheses.count as u32, OUTSIDE.to_bits()])?;
        let found = gpu.zeros::<[f32; 2]>("the winners", n)?;
        let call =
            self.kernels.call(&kernel, folded(n, 1), &[&about, &loaded.seen, &loaded.costs, &loaded.sums, &found])?;
        gpu.submit(&[&[call]])?;
        let found = gpu.read(&found, n)?;
        out.extend(found.into_iter().map(|[index, margin]| match index {
            _ if index < 0.0 => Winner::NONE,
            _ if margin < 0.0 => Winner { index, margin: f32::INFINITY },
            _ => Winner { index, margin },
        }));
        Ok(())
    }
}

/// Returns the winner of every pixel; no buffer of a slab is larger than `max_bytes`. See [`super::winners`], which takes
/// the largest buffers of the device.
///
/// # Errors
///
/// The device failed, a row of the image does not fit into `max_bytes`, or two rows of a pixel's hypotheses not into
/// the memory that threads share.
pub fn winners(gpu: &Arc<Gpu>, problem: &Problem<'_>, max_bytes: u64) -> Result<Vec<Winner>, DeviceError> {
    if problem.pixels.is_empty() {
        return Ok(Vec::new());
    }
    if problem.hypotheses.count > MAX_HYPOTHESES {
        let what =
            format!("two rows of {} depth hypotheses in the memory that threads share", problem.hypotheses.count);
        let (needed, max) = (8 * problem.hypotheses.count as u64, SHARED_BYTES as u64);
        return Err(DeviceError::Memory { device: gpu.name().to_owned(), what, needed, max });
    }
    let slabs = slabs(problem, gpu.name(), max_bytes)?;
    let mut solver = Solver { gpu, problem, kernels: Kernels::new(gpu) };
    let (nodes, lit) = (nodes(gpu, problem)?, lit(gpu, problem)?);
    let loaded = slabs.into_iter().map(|s| solver.load(s, &nodes, &lit)).collect::<Result<Vec<_>, _>>()?;
    // Only what leaves a slab is carried.
    let lines = if loaded.len() > 1 { problem.width + problem.height - 1 } else { 0 };
    let carry = gpu.zeros("the paths between slabs", lines * (problem.hypotheses.count + 1))?;
    for d in 0..DIRECTIONS.len() {
        solver.walk(d, &loaded, &carry)?;
    }
    let mut out = Vec::with_capacity(problem.pixels.len());
    for slab in &loaded {
        solver.choose(slab, &mut out)?;
    }
    Ok(out)
}
