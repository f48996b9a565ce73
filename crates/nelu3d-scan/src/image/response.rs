//! How a camera's codes follow light.

/// How codes follow light: both as parts of full scale, 0 at the black level and 1 at the saturation.
#[derive(Clone, Debug, PartialEq)]
pub enum Response {
    /// Codes are proportional to light.
    Linear,
    /// Codes are those of sRGB (IEC 61966-2-1): what webcams and phones deliver, about.
    Srgb,
    /// A measured curve, with straight lines between its points.
    Table {
        /// Name of the file it comes from.
        file: String,
        /// Codes, rising from 0 to 1.
        code: Vec<f64>,
        /// The light of each, rising from 0 to 1.
        light: Vec<f64>,
    },
}

impl Response {
    /// Makes the curve of a file's content, `{"code": […], "light": […]}`.
    ///
    /// # Errors
    ///
    /// It is no such JSON; or the lists differ in length, do not rise, or do not lead from 0 to 1.
    pub fn from_json(file: &str, bytes: &[u8]) -> Result<Self, String> {
        #[derive(serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Curve {
            code: Vec<f64>,
            light: Vec<f64>,
        }
        let Curve { code, light } = serde_json::from_slice(bytes).map_err(|e| e.to_string())?;
        if code.len() != light.len() || code.len() < 2 {
            return Err(format!("has {} codes and {} values of light", code.len(), light.len()));
        }
        for (name, list) in [("code", &code), ("light", &light)] {
            // Written so that it fails for what is not a number.
            if !list.windows(2).all(|w| w[0] < w[1]) {
                return Err(format!("`{name}` does not rise from each value to the next"));
            }
            if list.first() != Some(&0.0) || list.last() != Some(&1.0) {
                return Err(format!("`{name}` does not lead from 0 to 1"));
            }
        }
        Ok(Self::Table { file: file.into(), code, light })
    }

    /// Returns the content of a file from which [`Response::from_json`] makes this curve; sRGB in steps of 8 bits.
    pub fn to_json(&self) -> String {
        let steps = |n: u32| (0..=n).map(|i| f64::from(i) / f64::from(n)).collect::<Vec<f64>>();
        let (code, light) = match self {
            Self::Linear => (steps(1), steps(1)),
            Self::Srgb => (steps(255), steps(255).into_iter().map(|c| self.light(c)).collect()),
            Self::Table { code, light, .. } => (code.clone(), light.clone()),
        };
        serde_json::json!({ "code": code, "light": light }).to_string() + "\n"
    }

    /// Returns its name in rig.toml.
    pub fn name(&self) -> &str {
        match self {
            Self::Linear => "linear",
            Self::Srgb => "srgb",
            Self::Table { file, .. } => file,
        }
    }

    /// Returns the light of a code. Below 0, where noise may lead, the curve is that above it, mirrored; from 1 on,
    /// where values are clipped, it stays what it is.
    pub fn light(&self, code: f64) -> f64 {
        if code >= 1.0 {
            return code;
        }
        if code < 0.0 {
            return -self.light(-code);
        }
        match self {
            Self::Linear => code,
            Self::Srgb if code <= 0.040_45 => code / 12.92,
            Self::Srgb => ((code + 0.055) / 1.055).powf(2.4),
            Self::Table { code: codes, light, .. } => {
                let i = codes.partition_point(|c| *c <= code).clamp(1, codes.len() - 1);
                let part = (code - codes[i - 1]) / (codes[i] - codes[i - 1]);
                light[i - 1] + part * (light[i] - light[i - 1])
            }
        }
    }
}
