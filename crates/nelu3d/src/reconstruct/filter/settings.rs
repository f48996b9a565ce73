//! When a pixel is rejected after the refinement.

use serde::Serialize;

/// Settings of the rejection of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FilterSettings {
    /// Mean χ² per measurement over 5 × 5 pixels above which no surface explains the codeword: at least and at most.
    /// Between them the scene decides, by its own χ².
    pub max_chi2: [f32; 2],
    /// That limit as a multiple of the χ² below which a fifth of the scene's pixels are: much of a picture may be a
    /// room outside the volume.
    pub chi2_over_good: f32,
    /// Fraction of a pixel's light that did not come directly from the light source above which too little did: sides
    /// in shadow are lit by what stands beside them, and explained by that at any depth.
    pub max_indirect: f32,
    /// χ² per measurement of a pixel at a depth discontinuity above which its codeword is a mixture of two surfaces.
    pub max_edge_chi2: f32,
    /// White − black of a pixel at an outline, as a fraction of that behind it, below which the surface covers too
    /// little of the pixel to be at its middle.
    pub least_covered: f32,
    /// Median χ² per measurement of a connected component above which no part of it is explained, whatever else.
    pub max_component_chi2: f32,
    /// Median fraction of light of unseen origin (ambient light, interreflection from what the camera does not see)
    /// above which a component is at a wrong depth, whatever else.
    pub max_component_unseen: f32,
    /// Fraction of foreign codewords that are explained as well as a component's own above which it is explained by
    /// chance. The fractions of these three limits add up: neither light of unseen origin nor a code that fits anything
    /// may buy a wrong period.
    pub max_component_chance: f32,
    /// That fraction where it cannot be tried: most of the picture's codewords may belong to the component.
    pub unknown_chance: f32,
    /// Median χ² per measurement of a component, where it is one of known noise, below which it is explained whatever
    /// chance achieves; wrong ones had 1.6 times as much at least.
    pub clear_chi2: f32,
    /// The same for the median fraction of light of unseen origin. Fractions of the two add up.
    pub clear_unseen: f32,
    /// Median χ² per measurement of a component, as a multiple of what is typical of the scene's explained pixels,
    /// above which it is at a wrong depth, unless it is below `clear_chi2`: of any component, and of one that `unique`
    /// holds for. Right ones had 3.3 times as much at most (1.9 but for one of 201 px), wrong periods 5.3 and more. A
    /// box under Gray code had 4.9 times as much as the wall behind it, and codewords from elsewhere 1.8 times as much
    /// as the box; wrong periods for which that holds had 7.7 times as much.
    pub chi2_over_typical: [f32; 2],
    /// Least χ² of foreign codewords, as a multiple of the component's own, from which the second limit holds.
    pub unique: f32,
    /// Fraction of a component's pixels that a point outside the calibrated volume explains far better, beyond what
    /// chance does, above which the component lies there.
    pub max_beyond: f32,
    /// Fraction of the decoded pixels from which these limits hold; below, they shrink, as what is explained among much
    /// that is not may be so by chance.
    pub explained: f32,
    /// Part of the limits that is left where next to nothing is explained.
    pub max_score_alone: f32,
    /// Times that chance explains as many pixels as a component has, of all that are explained nowhere, from which the
    /// component has to fit better than `clear_chi2` and `clear_unseen` ask for, and from which as well as the next
    /// says.
    pub tries: [f32; 2],
    /// Part of `clear_chi2` and `clear_unseen`, together, that a component may have which chance explains that often.
    pub clear_by_chance: f32,
    /// Fraction of the decoded pixels that is explained nowhere from which components are judged in pieces.
    pub in_pieces: f32,
    /// Smallest connected component that is valid, px.
    pub min_component: usize,
}

impl FilterSettings {
    /// Returns χ² per measurement and a fraction of light of unseen origin as parts of what noise alone lets fit; 1 is the
    /// limit.
    pub(super) fn clear(&self, chi2: f32, unseen: f32) -> f32 {
        chi2 / self.clear_chi2 + unseen / self.clear_unseen
    }
}

impl Default for FilterSettings {
    fn default() -> Self {
        Self {
            max_chi2: [10.0, 40.0],
            chi2_over_good: 20.0,
            max_indirect: 0.4,
            max_edge_chi2: 9.0,
            least_covered: 0.5,
            max_component_chi2: 8.75,
            max_component_unseen: 0.4,
            max_component_chance: 0.5,
            unknown_chance: 0.3,
            clear_chi2: 1.75,
            clear_unseen: 0.08,
            chi2_over_typical: [4.0, 6.0],
            unique: 1.5,
            max_beyond: 0.25,
            explained: 0.25,
            max_score_alone: 0.5,
            tries: [0.15, 1.0],
            clear_by_chance: 0.65,
            in_pieces: 0.1,
            min_component: 40,
        }
    }
}
