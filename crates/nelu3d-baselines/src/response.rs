//! The radiometric response of a projector: how much light a projected value makes.

use serde::{Deserialize, Serialize};

/// Light as a function of the projected value: piecewise linear, monotone, both from 0 to 1, where light 1 is the white
/// (flash) image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Response {
    /// Projected values, rising.
    pub value: Vec<f32>,
    /// Light at each value.
    pub light: Vec<f32>,
    /// The power γ of `value^γ` that is nearest to it.
    pub gamma: f64,
    /// The images that it was measured with.
    pub images: Vec<String>,
}

impl Response {
    /// Checks a response from a file and says what is wrong with it.
    pub(crate) fn check(&self) -> Result<(), &'static str> {
        let rising = |v: &[f32], strictly: bool| v.windows(2).all(|w| w[0] < w[1] || (!strictly && w[0] == w[1]));
        if self.value.len() != self.light.len() || self.value.len() < 2 {
            return Err("needs as many values as lights, two or more");
        }
        if self.value.iter().chain(&self.light).any(|v| !(0.0..=1.0).contains(v)) {
            return Err("holds numbers outside of 0 to 1");
        }
        if !rising(&self.value, true) || !rising(&self.light, false) {
            return Err("does not rise");
        }
        Ok(())
    }

    /// Returns the light of a projected value.
    pub fn light_of(&self, value: f32) -> f32 {
        let last = self.value.len() - 1;
        let at = self.value.partition_point(|v| *v <= value).clamp(1, last);
        let (a, b) = (self.value[at - 1], self.value[at]);
        let f = ((value - a) / (b - a)).clamp(0.0, 1.0);
        self.light[at - 1] + f * (self.light[at] - self.light[at - 1])
    }
}
