//! What the camera sees: closed-form objects and triangles, with exact intersections. The sweep's board is such an object too.

pub(crate) mod albedo;
mod deformation;
pub(crate) mod material;
pub(crate) mod shape;
mod triangles;

use std::f64::consts::TAU;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use nelu3d_scan::board::{Artwork, Board};
use nelu3d_scan::{Mesh, Ray};

use crate::spec::{AlbedoSpec, ObjectSpec, ShapeSpec, SpecError};
use albedo::Albedo;
use material::{Material, frame};
use shape::{Meeting, Place, Shape};

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
    material: Material,
}

/// The first surface along a ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hit {
    /// Where, camera frame, mm.
    pub(crate) point: Point3<f64>,
    /// Unit normal on the ray's side, as light sees it: of the smooth surface that a mesh stands for.
    pub(crate) normal: Vector3<f64>,
    /// Unit normal of the surface itself on the ray's side.
    surface: Vector3<f64>,
    /// Which object.
    object: usize,
    /// Where, in the object's frame.
    local: Point3<f64>,
    /// Where, on the object's triangles.
    place: Option<Place>,
}

impl Scene {
    /// The scene of a checked spec.
    ///
    /// # Errors
    ///
    /// A file that an object names cannot be read (any more).
    pub(crate) fn new(objects: &[ObjectSpec]) -> Result<Self, SpecError> {
        let objects = objects.iter().map(|o| Object::read(o, &|field| format!("objects.{field}")));
        Ok(Self { objects: objects.collect::<Result<_, _>>()? })
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
        Self { objects: vec![Object::new(shape, *cam_from_board, albedo, Material::Lambert)] }
    }

    /// The first surface along a ray.
    pub(crate) fn hit(&self, ray: &Ray) -> Option<Hit> {
        let mut nearest: Option<(f64, Hit)> = None;
        for (i, o) in self.objects.iter().enumerate() {
            let limit = nearest.map_or(f64::INFINITY, |(t, _)| t);
            let local = o.localize(ray);
            if let Some(meeting) = o.shape.hit(&local, limit) {
                nearest = Some((meeting.t, o.hit(i, ray, &local, &meeting)));
            }
        }
        nearest.map(|(_, hit)| hit)
    }

    /// Whether nothing stands between a surface and a point.
    pub(crate) fn sees(&self, hit: &Hit, to: &Point3<f64>) -> bool {
        let origin = hit.point + hit.surface * SURFACE_OFFSET_MM;
        let way = to - origin;
        let distance = way.norm();
        let ray = Ray { origin, dir: way / distance };
        self.objects.iter().all(|o| !o.shape.blocks(&o.localize(&ray), distance))
    }

    /// The first surface that a surface sees in a direction; none behind the surface itself.
    pub(crate) fn next(&self, hit: &Hit, dir: Vector3<f64>) -> Option<Hit> {
        if dir.dot(&hit.surface) <= 0.0 {
            return None;
        }
        self.hit(&Ray { origin: hit.point + hit.surface * SURFACE_OFFSET_MM, dir })
    }

    /// A point of the same surface at a distance whose distribution is exponential, in any direction: where light enters
    /// that leaves here. Where the surface ends before, it is the point itself. `u` are two random numbers.
    pub(crate) fn beside(&self, hit: &Hit, mean_distance: f64, u: [f64; 2]) -> Hit {
        let distance = -mean_distance * (1.0 - u[0]).ln();
        let (sine, cosine) = (TAU * u[1]).sin_cos();
        let offset = frame(&hit.surface) * Vector3::new(distance * cosine, distance * sine, 0.0);
        // Surfaces bend away from the tangent plane by at most about the distance.
        let reach = distance.max(SURFACE_OFFSET_MM);
        let ray = Ray { origin: hit.point + offset + hit.surface * reach, dir: -hit.surface };
        let o = &self.objects[hit.object];
        let local = o.localize(&ray);
        let meeting = o.shape.hit(&local, 2.0 * reach);
        meeting.map_or(*hit, |meeting| o.hit(hit.object, &ray, &local, &meeting))
    }

    /// How much of each band of light (red, green, blue) the surface reflects.
    pub(crate) fn albedo(&self, hit: &Hit) -> [f32; 3] {
        let o = &self.objects[hit.object];
        match (&o.albedo, &o.shape, hit.place) {
            (Albedo::Vertices(colors), Shape::Triangles(t), Some(place)) => {
                let rgb = t.interpolate(&place, |i| colors[i]);
                [rgb.x as f32, rgb.y as f32, rgb.z as f32]
            }
            _ => o.albedo.at(&hit.local),
        }
    }

    /// How the surface reflects.
    pub(crate) fn material(&self, hit: &Hit) -> &Material {
        &self.objects[hit.object].material
    }

    /// Whether light can go from one of the surfaces to another and then to the camera.
    pub(crate) fn interreflects(&self) -> bool {
        match self.objects.as_slice() {
            [] => false,
            [only] => !only.shape.is_convex_from(&(only.object_from_cam * Point3::origin())),
            _ => true,
        }
    }

    /// All surfaces as triangles in the camera's frame, with vertices and normals on the true surface; of a mesh, its own.
    pub(crate) fn mesh(&self) -> Mesh {
        let mut all = Mesh::default();
        for o in &self.objects {
            let mut part = o.shape.mesh();
            if part.normals.is_empty() {
                part.compute_normals();
            }
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
    fn new(shape: Shape, cam_from_object: Isometry3<f64>, albedo: Albedo, material: Material) -> Self {
        Self { shape, cam_from_object, object_from_cam: cam_from_object.inverse(), albedo, material }
    }

    /// The object of a spec with its files; `key` names its fields in messages.
    fn read(spec: &ObjectSpec, key: &dyn Fn(&str) -> String) -> Result<Self, SpecError> {
        let mesh = match &spec.shape {
            ShapeSpec::Mesh { file, .. } => {
                Mesh::read(file).map_err(|source| SpecError::Mesh { key: key("shape.file"), source })?
            }
            _ => Mesh::default(),
        };
        let nothing = |what: &str, key: String, remedy: &str| {
            let ShapeSpec::Mesh { file, .. } = &spec.shape else { return Ok(()) };
            let value = format!("{}, which has no {what}", file.display());
            Err(SpecError::Value { key, value, remedy: remedy.into() })
        };
        if mesh.faces.is_empty() {
            nothing("triangles", key("shape.file"), "give a mesh with faces")?;
        }
        if matches!(spec.albedo, AlbedoSpec::VertexColors { .. }) && mesh.colors.is_empty() {
            nothing("vertex colors", key("albedo.kind"), "give another albedo, or a mesh with colors")?;
        }
        let albedo = Albedo::new(&spec.albedo, &mesh.colors)
            .map_err(|source| SpecError::Image { key: key("albedo.file"), source })?;
        let mut shape = Shape::new(&spec.shape, &mesh);
        if let Some(deformation) = &spec.deformation {
            shape = shape.deformed(deformation);
        }
        let cam_from_object = Isometry3::new(Vector3::from(spec.position_mm), Vector3::from(spec.rotation));
        Ok(Self::new(shape, cam_from_object, albedo, Material::new(&spec.material)))
    }

    /// What a ray (in the camera's frame, and `local` in the object's) meets.
    fn hit(&self, object: usize, ray: &Ray, local: &Ray, meeting: &Meeting) -> Hit {
        let mut surface = self.cam_from_object * meeting.normal;
        if surface.dot(&ray.dir) > 0.0 {
            surface = -surface;
        }
        let mut normal = surface;
        let mut rest = local.at(meeting.t);
        if let (Some(place), Shape::Triangles(triangles)) = (&meeting.place, &self.shape) {
            normal = self.cam_from_object * meeting.smooth;
            if normal.dot(&surface) < 0.0 {
                normal = -normal;
            }
            // Paint moves with the surface.
            rest = triangles.at_rest(place).unwrap_or(rest);
        }
        Hit { point: ray.at(meeting.t), normal, surface, object, local: rest, place: meeting.place }
    }

    fn localize(&self, ray: &Ray) -> Ray {
        Ray { origin: self.object_from_cam * ray.origin, dir: self.object_from_cam * ray.dir }
    }
}

/// Whether the files that an object names can be used.
///
/// # Errors
///
/// Under its key, the file that cannot.
pub(crate) fn check_files(spec: &ObjectSpec, key: &dyn Fn(&str) -> String) -> Result<(), SpecError> {
    let has_files = matches!(spec.shape, ShapeSpec::Mesh { .. }) || matches!(spec.albedo, AlbedoSpec::Image { .. });
    if has_files { Object::read(spec, key).map(drop) } else { Ok(()) }
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
