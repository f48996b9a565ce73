//! Which of the cameras that are plugged in.

use viva_u3v::U3vDeviceInfo;

use crate::error::CaptureError;
use crate::genicam::fix::failure;

/// What is searched, as errors name it.
pub(super) const USB: &str = "USB";
/// What to do about a camera that cannot be opened.
pub(super) const MAY_OPEN: &str = if cfg!(target_os = "linux") {
    "see that no other program has it and that you may open it: write SUBSYSTEM==\"usb\", \
     ENV{ID_USB_INTERFACES}==\"*:ef0500:*\", MODE=\"0666\" into /etc/udev/rules.d/70-usb3-vision.rules, and plug it in \
     again"
} else {
    "see that no other program has it, and plug it in again"
};

/// Returns the camera with this serial number, or the only one.
pub(super) fn choose<'a>(found: &'a [U3vDeviceInfo], serial: Option<&str>) -> Result<&'a U3vDeviceInfo, CaptureError> {
    let all = || found.iter().map(name).collect::<Vec<_>>().join(", ");
    match (serial, found) {
        (_, []) => Err(failure(
            USB,
            &"has no USB3 Vision camera",
            "plug it into a port of USB 3, see that it has power, and that its own program finds it",
        )),
        (None, [one]) => Ok(one),
        (None, _) => Err(failure(
            USB,
            &format!("has several cameras: {}", all()),
            "give the serial number of one of them instead of auto",
        )),
        (Some(serial), _) => found.iter().find(|c| c.serial.as_deref() == Some(serial)).ok_or_else(|| {
            failure(
                USB,
                &format!("has no camera with the serial number {serial}, but {}", all()),
                "give the serial number of what is plugged in, or auto",
            )
        }),
    }
}

/// Returns what a camera is called in sentences.
pub(super) fn name(camera: &U3vDeviceInfo) -> String {
    let text = |t: &Option<String>| t.clone().unwrap_or_default();
    named(&text(&camera.serial), &text(&camera.model))
}

/// Returns what a camera with this serial number and model is called in sentences.
pub(super) fn named(serial: &str, model: &str) -> String {
    let model = if model.is_empty() { "unknown model" } else { model };
    let serial = if serial.is_empty() { "without serial number" } else { serial };
    format!("the camera {serial} ({model})")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(serial: Option<&str>, model: Option<&str>) -> U3vDeviceInfo {
        U3vDeviceInfo {
            bus: "1".into(),
            address: 2,
            vendor_id: 3,
            product_id: 4,
            serial: serial.map(Into::into),
            manufacturer: None,
            model: model.map(Into::into),
            speed: None,
        }
    }

    #[test]
    fn one_camera_is_chosen_or_all_are_named() {
        let says = |found: &[U3vDeviceInfo], serial| choose(found, serial).unwrap_err().to_string();
        let none = says(&[], None);
        assert!(none.starts_with("USB: has no USB3 Vision camera; plug it"), "{none}");
        assert_eq!(says(&[], Some("A7")), none);
        let two = [camera(Some("A7"), Some("Eye")), camera(None, None)];
        assert_eq!(choose(&two[..1], None).unwrap(), &two[0]);
        assert_eq!(choose(&two, Some("A7")).unwrap(), &two[0]);
        let several = says(&two, None);
        let both = "the camera A7 (Eye), the camera without serial number (unknown model)";
        assert!(several.contains(both) && several.contains("serial number of one"), "{several}");
        let other = says(&two[..1], Some("B8"));
        assert!(other.contains("B8, but the camera A7 (Eye);"), "{other}");
    }
}
