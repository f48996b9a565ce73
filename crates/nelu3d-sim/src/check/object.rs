//! Checks of objects: shape, albedo, material, deformation, and the files they name.

use super::rules::{check, finite, positive, within};
use crate::scene::check_files;
use crate::scene::shape::Vase;
use crate::spec::{AlbedoSpec, AxisSpec, DeformationSpec, MaterialSpec, ObjectSpec, ShapeSpec, SpecError};

/// Names a field of an object in messages, by its path from the object.
type KeyOf<'a> = &'a dyn Fn(&str) -> String;

/// Checks an object of the scene or sequence `owner`, and reads the files it names.
pub(super) fn check_object(owner: &str, object: &ObjectSpec) -> Result<(), SpecError> {
    let key = |field: &str| format!("{owner}: objects.{field}");
    finite(&key("position_mm"), &object.position_mm)?;
    finite(&key("rotation"), &object.rotation)?;
    check_shape(&key, &object.shape)?;
    check_albedo(&key, object)?;
    check_material(&key, &object.material)?;
    if let Some(deformation) = &object.deformation {
        check_deformation(&key, deformation)?;
    }
    check_files(object, &key)
}

fn check_shape(key: KeyOf, shape: &ShapeSpec) -> Result<(), SpecError> {
    match shape {
        ShapeSpec::Plane { width_mm, height_mm } => {
            positive(&key("shape.width_mm"), *width_mm)?;
            positive(&key("shape.height_mm"), *height_mm)?;
        }
        ShapeSpec::Sphere { radius_mm } => positive(&key("shape.radius_mm"), *radius_mm)?,
        ShapeSpec::Step { width_mm, height_mm, jump_mm } => {
            positive(&key("shape.width_mm"), *width_mm)?;
            positive(&key("shape.height_mm"), *height_mm)?;
            finite(&key("shape.jump_mm"), &[*jump_mm])?;
        }
        ShapeSpec::Vase { profile_mm } => {
            finite(&key("shape.profile_mm"), profile_mm.as_flattened())?;
            let (good, key) = (Vase::new(profile_mm).is_some(), key("shape.profile_mm"));
            let remedy = "give [height, radius] pairs, 2 to 1000, heights rising, radii above 0, and no sudden narrowing \
                          between them (the curve through them must not reach the axis)";
            check(good, key, format!("{profile_mm:?}"), remedy)?;
        }
        ShapeSpec::Box { size_mm } => {
            positive(&key("shape.size_mm"), size_mm.iter().copied().fold(f64::INFINITY, f64::min))?;
            finite(&key("shape.size_mm"), size_mm)?;
        }
        ShapeSpec::Cylinder { radius_mm, height_mm } => {
            positive(&key("shape.radius_mm"), *radius_mm)?;
            positive(&key("shape.height_mm"), *height_mm)?;
        }
        ShapeSpec::Torus { major_mm, minor_mm } => {
            positive(&key("shape.minor_mm"), *minor_mm)?;
            let good = major_mm > minor_mm && *major_mm < 1e7;
            check(good, key("shape.major_mm"), major_mm, "it must be larger than minor_mm")?;
        }
        ShapeSpec::Mesh { scale, .. } => positive(&key("shape.scale"), *scale)?,
    }
    Ok(())
}

fn check_albedo(key: KeyOf, object: &ObjectSpec) -> Result<(), SpecError> {
    let (colors, length) = match &object.albedo {
        AlbedoSpec::Constant { rgb } => (vec![*rgb], ("", 1.0)),
        AlbedoSpec::Waves { from, to, period_mm } => (vec![*from, *to], ("period_mm", *period_mm)),
        AlbedoSpec::Checker { from, to, size_mm } => (vec![*from, *to], ("size_mm", *size_mm)),
        AlbedoSpec::Wood { from, to, ring_mm, .. } => (vec![*from, *to], ("ring_mm", *ring_mm)),
        AlbedoSpec::Image { size_mm: [w, h], .. } => (vec![], ("size_mm", w.min(*h))),
        AlbedoSpec::VertexColors { .. } => {
            let mesh = matches!(object.shape, ShapeSpec::Mesh { .. });
            check(
                mesh,
                key("albedo.kind"),
                "vertex-colors",
                "only a mesh has vertices with colors; give another kind",
            )?;
            return Ok(());
        }
    };
    for v in colors.as_flattened() {
        within(&key("albedo"), *v, 0.0, 1.0)?;
    }
    positive(&key(&format!("albedo.{}", length.0)), length.1)
}

fn check_material(key: KeyOf, material: &MaterialSpec) -> Result<(), SpecError> {
    match *material {
        MaterialSpec::Lambert {} => Ok(()),
        MaterialSpec::Glossy { roughness, reflectance } => {
            within(&key("material.roughness"), roughness, 0.05, 1.0)?;
            within(&key("material.reflectance"), reflectance, 0.0, 1.0)
        }
        MaterialSpec::Translucent { mean_free_path_mm, share } => {
            positive(&key("material.mean_free_path_mm"), mean_free_path_mm)?;
            within(&key("material.share"), share, 0.0, 1.0)
        }
    }
}

fn check_deformation(key: KeyOf, deformation: &DeformationSpec) -> Result<(), SpecError> {
    match *deformation {
        DeformationSpec::Wave { amplitude_mm, wavelength_mm, phase, direction } => {
            finite(&key("deformation.amplitude_mm, phase"), &[amplitude_mm, phase])?;
            positive(&key("deformation.wavelength_mm"), wavelength_mm)?;
            check_direction(key, &direction)
        }
        DeformationSpec::Bend { curvature_per_mm, axis } => {
            let remedy = "a sheet in z = 0 bends about x or y; give one of them";
            check(axis != AxisSpec::Z, key("deformation.axis"), "z", remedy)?;
            within(&key("deformation.curvature_per_mm"), curvature_per_mm, -10.0, 10.0)
        }
        DeformationSpec::Curl { height_mm, from_mm, to_mm, direction } => {
            finite(&key("deformation.height_mm, from_mm, to_mm"), &[height_mm, from_mm, to_mm])?;
            check(to_mm > from_mm, key("deformation.to_mm"), to_mm, "give more than from_mm")?;
            check_direction(key, &direction)
        }
        DeformationSpec::Twist { rate_per_mm, .. } => within(&key("deformation.rate_per_mm"), rate_per_mm, -10.0, 10.0),
    }
}

fn check_direction(key: KeyOf, direction: &[f64; 3]) -> Result<(), SpecError> {
    finite(&key("deformation.direction"), direction)?;
    let length = direction.iter().map(|v| v * v).sum::<f64>().sqrt();
    let shown = format!("{direction:?}");
    check(length > 1e-6, key("deformation.direction"), shown, "give the direction along which it changes")
}
