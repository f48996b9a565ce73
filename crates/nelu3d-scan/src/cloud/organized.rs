//! The cloud itself.

/// One point per pixel, row by row. All parts are of the same length, width × height.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OrganizedCloud {
    /// Width of the grid, px.
    pub width: usize,
    /// Height of the grid, px.
    pub height: usize,
    /// Positions in the camera's frame, mm; NaN where there is no point.
    pub positions: Vec<[f32; 3]>,
    /// Unit normals; NaN where there is no point.
    pub normals: Vec<[f32; 3]>,
    /// Colors, sRGB.
    pub colors: Vec<[u8; 3]>,
    /// One standard deviation of the depth, mm; NaN where there is no point.
    pub sigma: Vec<f32>,
}

impl OrganizedCloud {
    /// Panics if the parts differ in length.
    pub(super) fn assert_whole(&self) {
        let n = self.width * self.height;
        let lengths = [self.positions.len(), self.normals.len(), self.colors.len(), self.sigma.len()];
        assert!(lengths.iter().all(|&length| length == n), "parts of {lengths:?} points for {n} pixels");
    }
}
