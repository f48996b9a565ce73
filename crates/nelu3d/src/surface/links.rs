//! Links between neighboring pixels of a depth map that belong to one surface, and its connected components.

use nelu3d_scan::Camera;

/// Links between neighboring pixels that belong to one surface: per pixel, bit 0 to the right neighbor, bit 1 to the
/// one below.
#[derive(Clone)]
pub struct Links(Vec<u8>);

impl Links {
    /// Links neighbors whose depths differ by no more than the surface's own slope explains. A step is a jump when it
    /// is larger than `max_slope` (depth per lateral distance, both mm) and also larger than four times the steps next
    /// to it in the same direction.
    pub fn new(depth: &[f32], camera: &Camera, max_slope: f32) -> Self {
        let (w, h) = (camera.width, camera.height);
        let lateral = 1.0 / (0.5 * (camera.fx + camera.fy)) as f32;
        let joined = |i: usize, stride: usize, before: bool, after: bool| -> bool {
            let j = i + stride;
            if !(depth[i].is_finite() && depth[j].is_finite()) {
                return false;
            }
            let step = (depth[j] - depth[i]).abs();
            let mm = lateral * depth[i].min(depth[j]);
            if step <= max_slope * mm {
                return true;
            }
            let side = |ok: bool, a: usize, b: usize| {
                if ok && depth[a].is_finite() && depth[b].is_finite() { (depth[b] - depth[a]).abs() } else { 0.0 }
            };
            let around = side(before, i.wrapping_sub(stride), i).min(side(after, j, (j + stride).min(depth.len() - 1)));
            step <= 12.0 * mm && step <= 4.0 * around
        };
        let mut links = vec![0u8; w * h];
        for y in 0..h {
            for x in 0..w {
                let i = y * w + x;
                if x + 1 < w && joined(i, 1, x > 0, x + 2 < w) {
                    links[i] |= 1;
                }
                if y + 1 < h && joined(i, w, y > 0, y + 2 < h) {
                    links[i] |= 2;
                }
            }
        }
        Self(links)
    }

    /// Cuts the links between neighbors that are apart.
    pub fn cut(&mut self, width: usize, are_apart: impl Fn(usize, usize) -> bool) {
        for (i, links) in self.0.iter_mut().enumerate() {
            for (bit, beside) in [(1, i + 1), (2, i + width)] {
                if *links & bit != 0 && are_apart(i, beside) {
                    *links &= !bit;
                }
            }
        }
    }

    /// Calls `f` with the two pixels of every link.
    pub fn for_each(&self, width: usize, mut f: impl FnMut(usize, usize)) {
        for i in 0..self.0.len() {
            if self.right(i) {
                f(i, i + 1);
            }
            if self.down(i) {
                f(i, i + width);
            }
        }
    }

    /// Returns whether pixel `i` is linked to its right neighbor.
    pub(super) fn right(&self, i: usize) -> bool {
        self.0[i] & 1 != 0
    }

    /// Returns whether pixel `i` is linked to the one below.
    pub(super) fn down(&self, i: usize) -> bool {
        self.0[i] & 2 != 0
    }

    /// Returns the pixels with a depth that are next to one of another surface.
    pub fn at_jumps(&self, depth: &[f32], width: usize) -> Vec<usize> {
        let mut at = vec![false; depth.len()];
        for i in 0..depth.len() {
            if !depth[i].is_finite() {
                continue;
            }
            let mut cut = |linked: bool, j: usize| {
                if !linked && j < depth.len() && depth[j].is_finite() {
                    at[i] = true;
                    at[j] = true;
                }
            };
            if i % width + 1 < width {
                cut(self.right(i), i + 1);
            }
            cut(self.down(i), i + width);
        }
        (0..depth.len()).filter(|i| at[*i]).collect()
    }

    /// Returns the size of each pixel's connected component (0 where there is no surface).
    pub fn component_sizes(&self, depth: &[f32], width: usize) -> Vec<u32> {
        let (component, sizes) = self.components(depth, width);
        component.iter().map(|c| if *c == u32::MAX { 0 } else { sizes[*c as usize] }).collect()
    }

    /// Returns the connected component of each pixel (`u32::MAX` where there is no surface), and the components' sizes.
    pub fn components(&self, depth: &[f32], width: usize) -> (Vec<u32>, Vec<u32>) {
        let n = depth.len();
        let mut component = vec![u32::MAX; n];
        let mut sizes = Vec::new();
        let mut stack = Vec::new();
        for seed in 0..n {
            if !depth[seed].is_finite() || component[seed] != u32::MAX {
                continue;
            }
            let id = sizes.len() as u32;
            let mut size = 0;
            component[seed] = id;
            stack.push(seed);
            while let Some(i) = stack.pop() {
                size += 1;
                let mut visit = |j: usize| {
                    if component[j] == u32::MAX {
                        component[j] = id;
                        stack.push(j);
                    }
                };
                if self.right(i) {
                    visit(i + 1);
                }
                if self.down(i) {
                    visit(i + width);
                }
                if i % width > 0 && self.right(i - 1) {
                    visit(i - 1);
                }
                if i >= width && self.down(i - width) {
                    visit(i - width);
                }
            }
            sizes.push(size);
        }
        (component, sizes)
    }
}
