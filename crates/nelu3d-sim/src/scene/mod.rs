//! What the camera sees: closed-form objects with exact intersections. The sweep's board is such an object too.

pub(crate) mod albedo;
pub(crate) mod shape;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use nelu3d_scan::board::{Artwork, Board};
use nelu3d_scan::{Mesh, Ray};

use crate::spec::ObjectSpec;
use albedo::Albedo;
use shape::Shape;

/// A surface keeps this distance from the rays that start on it, mm.
const SURFACE_OFFSET_MM: f64 = 1e-4;

/// Objects in the camera's frame.
#[derive(Clone, Debug)]
pub(crate) struct Scene {
    objects: Vec<Object>,
}

#[derive(Clone, Debug)]
struct Object {
    shape: Shape,
    cam_from_object: Isometry3<f64>,
    object_from_cam: Isometry3<f64>,
    albedo: Albedo,
}

/// The first surface along a ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hit {
    /// Where, camera frame, mm.
    pub(crate) point: Point3<f64>,
    /// Unit normal on the ray's side.
    pub(crate) normal: Vector3<f64>,
    /// Which object.
    object: usize,
    /// Where, in the object's frame.
    local: Point3<f64>,
}

impl Scene {
    /// The scene of a checked spec.
    pub(crate) fn new(objects: &[ObjectSpec]) -> Self {
        let objects = objects.iter().map(|o| {
            let cam_from_object = Isometry3::new(Vector3::from(o.position_mm), Vector3::from(o.rotation));
            Object::new(Shape::new(&o.shape), cam_from_object, Albedo::new(&o.albedo))
        });
        Self { objects: objects.collect() }
    }

    /// A board by itself, printed in dots or, without `print_dpi`, exactly.
    pub(crate) fn of_board(
        board: &Board,
        artwork: Artwork,
        [ink, paper]: [f64; 2],
        print_dpi: Option<f64>,
        cam_from_board: &Isometry3<f64>,
    ) -> Self {
        let [x0, y0, x1, y1] = board.extent_mm;
        let shape = Shape::Rectangle(shape::Rectangle::new([x0, y0], [x1, y1]));
        let dot_mm = print_dpi.map_or(0.0, |dpi| 25.4 / dpi);
        let albedo = Albedo::Board { artwork: Box::new(artwork), ink: ink as f32, paper: paper as f32, dot_mm };
        Self { objects: vec![Object::new(shape, *cam_from_board, albedo)] }
    }

    /// The first surface along a ray.
    pub(crate) fn hit(&self, ray: &Ray) -> Option<Hit> {
        let mut nearest: Option<(f64, Hit)> = None;
        for (object, o) in self.objects.iter().enumerate() {
            let local = o.localize(ray);
            let limit = nearest.map_or(f64::INFINITY, |(t, _)| t);
            if let Some((t, normal)) = o.shape.hit(&local, limit) {
                let mut normal = o.cam_from_object * normal;
                if normal.dot(&ray.dir) > 0.0 {
                    normal = -normal;
                }
                nearest = Some((t, Hit { point: ray.at(t), normal, object, local: local.at(t) }));
            }
        }
        nearest.map(|(_, hit)| hit)
    }

    /// Whether nothing stands between a surface and a point.
    pub(crate) fn sees(&self, hit: &Hit, to: &Point3<f64>) -> bool {
        let origin = hit.point + hit.normal * SURFACE_OFFSET_MM;
        let way = to - origin;
        let distance = way.norm();
        let ray = Ray { origin, dir: way / distance };
        self.objects.iter().all(|o| o.shape.hit(&o.localize(&ray), distance).is_none())
    }

    /// How much of each band of light (red, green, blue) the surface reflects.
    pub(crate) fn albedo(&self, hit: &Hit) -> [f32; 3] {
        self.objects[hit.object].albedo.at(&hit.local)
    }

    /// All surfaces as triangles in the camera's frame, with vertices and normals on the true surface.
    pub(crate) fn mesh(&self) -> Mesh {
        let mut all = Mesh::default();
        for o in &self.objects {
            let part = o.shape.mesh();
            let first = all.vertices.len() as u32;
            all.vertices.extend(part.vertices.iter().map(|v| {
                let p = o.cam_from_object * Point3::from(v.map(f64::from));
                [p.x as f32, p.y as f32, p.z as f32]
            }));
            all.normals.extend(part.normals.iter().map(|n| {
                let n = o.cam_from_object * Vector3::from(n.map(f64::from));
                [n.x as f32, n.y as f32, n.z as f32]
            }));
            all.faces.extend(part.faces.iter().map(|f| f.map(|i| i + first)));
        }
        all
    }
}

impl Object {
    fn new(shape: Shape, cam_from_object: Isometry3<f64>, albedo: Albedo) -> Self {
        Self { shape, cam_from_object, object_from_cam: cam_from_object.inverse(), albedo }
    }

    fn localize(&self, ray: &Ray) -> Ray {
        Ray { origin: self.object_from_cam * ray.origin, dir: self.object_from_cam * ray.dir }
    }
}

/// The pose of something at `position` that looks along its z axis at `target`, its x axis level (no y component):
/// camera from thing.
pub(crate) fn look_at(position: [f64; 3], target: [f64; 3]) -> Isometry3<f64> {
    let position = Point3::from(position);
    let z = (Point3::from(target) - position).normalize();
    let x = Vector3::y().cross(&z).normalize();
    let y = z.cross(&x);
    let rotation = UnitQuaternion::from_basis_unchecked(&[x, y, z]);
    Isometry3::from_parts(Translation3::from(position), rotation)
}
