//! The cube of a signed distance field.

use nalgebra::{Point3, Vector3};

/// Side of the cube, units.
pub const SIDE: f64 = 3.0;

/// A cube in the camera's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Center, mm.
    pub center: Point3<f64>,
    /// Length of one unit of the field's distances, mm: a third of the cube's side.
    pub unit_mm: f64,
}

impl Bounds {
    /// Returns the smallest cube around points, a little enlarged; `None` if it would be empty.
    pub fn around(points: impl IntoIterator<Item = Point3<f64>>) -> Option<Self> {
        let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for p in points {
            for a in 0..3 {
                lo[a] = lo[a].min(p[a]);
                hi[a] = hi[a].max(p[a]);
            }
        }
        let longest = (0..3).map(|a| hi[a] - lo[a]).fold(f64::NEG_INFINITY, f64::max);
        let center = Point3::from(std::array::from_fn::<f64, 3, _>(|a| 0.5 * (lo[a] + hi[a])));
        (longest > 0.0 && longest.is_finite()).then(|| Self { center, unit_mm: 1.02 * longest / SIDE })
    }

    /// Returns the cube around the same center whose unit is `unit_mm`.
    pub fn with_unit(self, unit_mm: f64) -> Self {
        Self { unit_mm, ..self }
    }

    /// Returns the side of the cube, mm.
    pub fn side_mm(&self) -> f64 {
        SIDE * self.unit_mm
    }

    /// Returns the coordinates of a point in the unit cube.
    pub fn to_cube(&self, x: &Point3<f64>) -> [f32; 3] {
        let p = (x - self.center) / self.side_mm();
        std::array::from_fn(|a| (p[a] + 0.5) as f32)
    }

    /// Returns the point with given coordinates in the unit cube, mm.
    pub fn from_cube(&self, q: [f32; 3]) -> Point3<f64> {
        self.center + Vector3::from(q.map(|q| f64::from(q) - 0.5)) * self.side_mm()
    }

    /// Returns the part of a ray that lies inside, as `[near, far]` of its parameter; near > far if none does.
    pub fn clip(&self, origin: &Point3<f64>, dir: &Vector3<f64>, [mut near, mut far]: [f64; 2]) -> [f64; 2] {
        let half = 0.5 * self.side_mm();
        for a in 0..3 {
            let from_center = origin[a] - self.center[a];
            let (t0, t1) = ((-half - from_center) / dir[a], (half - from_center) / dir[a]);
            // Along a face both are infinite or NaN; NaN leaves the range as it is.
            near = near.max(t0.min(t1));
            far = far.min(t0.max(t1));
        }
        [near, far]
    }
}
