//! Why a response cannot be measured.

/// Why a response cannot be measured: what is wrong with the images, and what to do about it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ResponseError {
    /// Images that belong together differ in size.
    #[error(
        "the images of one scene differ in size or channels ({first} and {other}); give images of one camera and setting"
    )]
    OtherSize {
        /// Size and channels of the first.
        first: String,
        /// Of another.
        other: String,
    },
    /// Next to no pixel sees a mixture of light without being clipped.
    #[error(
        "only {blocks} parts of the picture tell something of the response ({needed} are needed): the others are dark, \
         clipped, or see single stripes; point camera and light source at the same bright surface, expose so that it \
         stays below saturation, and defocus one of them where stripes are sharp"
    )]
    TooLittle {
        /// Parts of the picture that can be used.
        blocks: usize,
        /// How many are needed.
        needed: usize,
    },
    /// The upper part of the scale is not used.
    #[error(
        "the brightest of the images uses {percent:.0} % of the camera's scale, so that nothing is known of what lies \
         above; expose longer, until the brightest surface uses about 80 %"
    )]
    TooDark {
        /// The part of the scale that is used, percent.
        percent: f64,
    },
    /// No curve makes light add up.
    #[error(
        "light does not add up: with the best curve, images differ from what they should show by {percent:.1} % of \
         their light; lock exposure, gain and white balance, switch the light source's dynamic contrast off, and keep \
         everything still"
    )]
    DoesNotAddUp {
        /// Typical difference, percent of the light.
        percent: f64,
    },
    /// The data leave the curve open.
    #[error(
        "the images leave the curve open by {percent:.1} % of full scale; take them again with the light source on a \
         surface with bright and dark parts, or with more and steadier images"
    )]
    Undetermined {
        /// Largest standard error of the curve, percent of full scale.
        percent: f64,
    },
}
