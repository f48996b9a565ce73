//! The center of a light, and the chart in which it is sought.

use nalgebra::{Point3, Vector3};

use crate::color_field::frame::FieldFrame;

/// The light's center seen from the middle of the volume: a direction and an inverse distance (0 = at infinity).
#[derive(Clone, Copy, Debug)]
pub struct LightCenter {
    /// Middle of the volume, mm.
    pub(in crate::calibrate) origin: Point3<f64>,
    /// Unit direction in which the light travels there.
    pub(in crate::calibrate) along: Vector3<f64>,
    /// One over the distance to the center, 1/mm.
    pub(in crate::calibrate) kappa: f64,
    /// Unit direction of the line on which the center lies, where the codes do not tell where on it: patterns that vary
    /// along one axis only.
    pub line: Option<Vector3<f64>>,
}

impl LightCenter {
    /// Where the light is, mm; `None` at infinity.
    pub fn position(&self) -> Option<Point3<f64>> {
        (self.kappa.abs() > 1e-9).then(|| self.origin - self.along / self.kappa)
    }

    /// Returns the center that a shift (`color_field/fit/light_shift.rs`) of a field in the frame of this one, with so
    /// many cells along a and b, asks for.
    pub(super) fn moved(&self, frame: &FieldFrame, cells: [usize; 2], shift: &Vector3<f64>) -> Self {
        let size = [0, 1, 2].map(|i| frame.hi[i] - frame.lo[i]);
        let [s1, s2, growth] = (*shift).into();
        // Rays that lean by so much, per mm along the axis, and spread by so much more, meet there.
        let lean = |i: usize, s: f64| {
            let middle = 0.5 * (frame.lo[i] + frame.hi[i]);
            (s * size[i] / cells[i] as f64 - growth * middle) / size[2]
        };
        let [e1, e2, e3] = frame.axes.map(Vector3::from);
        let along = (e3 - e1 * lean(0, s1) - e2 * lean(1, s2)).normalize();
        Self { along, kappa: self.kappa - growth / size[2], ..*self }
    }
}

/// A point of the chart: two tangents of the direction's offsets, and `kappa · scale`.
pub type State = [f64; 3];

/// The state of a light in the camera itself.
pub(super) const HOME: State = [0.0, 0.0, 1.0];

/// A chart of centers around the middle of the volume.
pub struct Chart {
    /// Middle of the volume, mm.
    pub(super) origin: Point3<f64>,
    /// Distance of the middle of the volume from the camera, mm: `kappa · scale` has no unit.
    pub scale: f64,
    base: Vector3<f64>,
    e1: Vector3<f64>,
    e2: Vector3<f64>,
}

impl Chart {
    /// A chart around the middle of the volume, mm in the camera's frame.
    pub fn new(origin: Point3<f64>) -> Self {
        let base = origin.coords.normalize();
        let e1 = (Vector3::x() - base * base.x).normalize();
        Self { origin, scale: origin.coords.norm(), base, e1, e2: base.cross(&e1) }
    }

    /// The center at a state.
    pub fn center(&self, s: State) -> LightCenter {
        let along = (self.base + self.e1 * s[0].tan() + self.e2 * s[1].tan()).normalize();
        LightCenter { origin: self.origin, along, kappa: s[2] / self.scale, line: None }
    }

    /// Returns the state of a center at a point, mm; `None` beside or behind the volume.
    pub fn state(&self, at: &Point3<f64>) -> Option<State> {
        let toward = self.origin - at;
        let depth = toward.dot(&self.base);
        let tangent = |e: Vector3<f64>| (toward.dot(&e) / depth).atan();
        (depth > 1e-3 * self.scale).then(|| [tangent(self.e1), tangent(self.e2), self.scale / toward.norm()])
    }

    /// Returns the derivatives of [`LightCenter::along`] and [`LightCenter::kappa`] at a state, one for each of its
    /// coordinates.
    pub fn slopes(&self, s: State) -> [Slope; 3] {
        let toward = self.base + self.e1 * s[0].tan() + self.e2 * s[1].tan();
        let (length, along) = (toward.norm(), toward.normalize());
        let tangent = |e: Vector3<f64>, s: f64| {
            let d = e / s.cos().powi(2);
            Slope { along: (d - along * along.dot(&d)) / length, kappa: 0.0 }
        };
        let distance = Slope { along: Vector3::zeros(), kappa: 1.0 / self.scale };
        [tangent(self.e1, s[0]), tangent(self.e2, s[1]), distance]
    }
}

/// Derivative of a light's center by one coordinate of the state.
#[derive(Clone, Copy, Debug)]
pub struct Slope {
    /// Derivative of the unit direction in which the light travels.
    pub(super) along: Vector3<f64>,
    /// Derivative of the inverse distance to the light's center, 1/mm.
    pub(super) kappa: f64,
}
