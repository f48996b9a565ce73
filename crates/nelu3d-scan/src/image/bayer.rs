//! Demosaicing: H. S. Malvar, L. He and R. Cutler, "High-quality linear interpolation for demosaicing of
//! Bayer-patterned color images", ICASSP 2004. Each missing color is bilinear interpolation plus a share of the
//! Laplacian of the color that was measured there: five 5×5 linear filters (their Fig. 2).

use rayon::prelude::*;

use super::Image;

/// How far the filters reach, px.
pub(crate) const REACH: usize = 2;

/// A linear filter: (dx, dy, weight).
type Taps<const N: usize> = [(isize, isize, f32); N];

/// Green at a red or blue pixel.
const CROSS: Taps<9> = [
    (0, 0, 0.5),
    (1, 0, 0.25),
    (-1, 0, 0.25),
    (0, 1, 0.25),
    (0, -1, 0.25),
    (2, 0, -0.125),
    (-2, 0, -0.125),
    (0, 2, -0.125),
    (0, -2, -0.125),
];

/// Red or blue at a green pixel, where the wanted color lies to the left and right.
const ROW: Taps<11> = [
    (0, 0, 0.625),
    (1, 0, 0.5),
    (-1, 0, 0.5),
    (2, 0, -0.125),
    (-2, 0, -0.125),
    (1, 1, -0.125),
    (-1, 1, -0.125),
    (1, -1, -0.125),
    (-1, -1, -0.125),
    (0, 2, 0.0625),
    (0, -2, 0.0625),
];

/// Red or blue at a green pixel, where the wanted color lies above and below.
const COLUMN: Taps<11> = transposed(ROW);

/// Red at a blue pixel and the reverse.
const DIAGONAL: Taps<9> = [
    (0, 0, 0.75),
    (1, 1, 0.25),
    (-1, 1, 0.25),
    (1, -1, 0.25),
    (-1, -1, 0.25),
    (2, 0, -0.1875),
    (-2, 0, -0.1875),
    (0, 2, -0.1875),
    (0, -2, -0.1875),
];

const fn transposed<const N: usize>(mut taps: Taps<N>) -> Taps<N> {
    let mut i = 0;
    while i < N {
        taps[i] = (taps[i].1, taps[i].0, taps[i].2);
        i += 1;
    }
    taps
}

/// The largest value that does not count as clipped.
const BELOW_CLIPPED: f32 = 1.0 - f32::EPSILON / 2.0;

/// Makes an RGB image of a linear mosaic of one channel whose 2×2 cell at the top left has the colors `cell`, row by
/// row (0 red, 1 green, 2 blue). A value is ≥ 1 if and only if a mosaic pixel that went into it was.
///
/// # Panics
///
/// If `mosaic` has more than one channel.
pub fn demosaic(mosaic: &Image, cell: [u8; 4]) -> Image {
    assert_eq!(mosaic.channels, 1, "a mosaic has one channel");
    let (w, h) = (mosaic.width, mosaic.height);
    let mut out = Image::new(w, h, 3);
    if w == 0 || h == 0 {
        return out;
    }
    out.data.par_chunks_mut(3 * w).enumerate().for_each_init(
        || [(); 4].map(|()| vec![0.0; w]),
        |[row, column, cross, diagonal], (y, rgb)| {
            // All filters at all pixels of a row: twice what is needed, in vectors.
            filter(mosaic, y, &ROW, row);
            filter(mosaic, y, &COLUMN, column);
            filter(mosaic, y, &CROSS, cross);
            filter(mosaic, y, &DIAGONAL, diagonal);
            // The color beside each green pixel of this row.
            let in_row = [cell[2 * (y % 2)], cell[2 * (y % 2) + 1]];
            let measured = &mosaic.data[y * w..][..w];
            for (x, rgb) in rgb.chunks_exact_mut(3).enumerate() {
                let here = in_row[x % 2];
                if here == 1 {
                    let beside = in_row[(x + 1) % 2];
                    rgb[1] = measured[x];
                    rgb[usize::from(beside)] = row[x];
                    rgb[usize::from(2 - beside)] = column[x];
                } else {
                    rgb[usize::from(here)] = measured[x];
                    rgb[1] = cross[x];
                    rgb[usize::from(2 - here)] = diagonal[x];
                }
            }
        },
    );
    out
}

/// Writes a filter of every pixel of row `y` to `out`.
fn filter<const N: usize>(mosaic: &Image, y: usize, taps: &Taps<N>, out: &mut [f32]) {
    let (w, h) = (mosaic.width, mosaic.height);
    let rows: [&[f32]; N] = taps.map(|(_, dy, _)| &mosaic.data[mirror(y as isize + dy, h) * w..][..w]);
    let filtered = |values: [f32; N]| {
        let (mut sum, mut brightest) = (0.0, f32::NEG_INFINITY);
        for n in 0..N {
            sum += taps[n].2 * values[n];
            brightest = brightest.max(values[n]);
        }
        // The filters overshoot at edges: that alone must not look like clipping, nor hide it.
        if brightest >= 1.0 { sum.max(1.0) } else { sum.min(BELOW_CLIPPED) }
    };
    let mirrored = |x: usize| filtered(std::array::from_fn(|n| rows[n][mirror(x as isize + taps[n].0, w)]));
    if w <= 2 * REACH {
        out.iter_mut().enumerate().for_each(|(x, out)| *out = mirrored(x));
        return;
    }
    let inner = w - 2 * REACH;
    let shifted: [&[f32]; N] = std::array::from_fn(|n| &rows[n][REACH.wrapping_add_signed(taps[n].0)..][..inner]);
    for (x, out) in out[REACH..][..inner].iter_mut().enumerate() {
        *out = filtered(shifted.map(|row| row[x]));
    }
    for x in (0..REACH).chain(w - REACH..w) {
        out[x] = mirrored(x);
    }
}

/// Mirrors an index at the first and last pixel, which keeps the mosaic's parity.
fn mirror(i: isize, n: usize) -> usize {
    let last = n as isize - 1;
    let mut i = i;
    // A mosaic narrower than the filter needs more than one reflection.
    while i < 0 || i > last {
        if last == 0 {
            return 0;
        }
        i = if i < 0 { -i } else { 2 * last - i };
    }
    i as usize
}
