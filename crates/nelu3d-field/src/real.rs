//! The scalar type of the reference implementations.

use std::fmt::Debug;
use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// `f32` or `f64`: references run in the first to compare with the fast forms, in the second to be checked by central
/// differences.
pub trait Real:
    Copy
    + Debug
    + Default
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + Sum
    + Send
    + Sync
{
    /// Returns the nearest value of this type.
    fn of(x: f64) -> Self;
    /// Returns the value widened (exactly) to `f64`.
    fn to_f64(self) -> f64;
    /// Returns e^x
    fn exp(self) -> Self;
    /// Returns e^x − 1 without cancellation at small x.
    fn exp_m1(self) -> Self;
    /// Returns ln(1 + x) without cancellation at small x.
    fn ln_1p(self) -> Self;
    /// Returns the natural logarithm.
    fn ln(self) -> Self;
    /// Returns the square root.
    fn sqrt(self) -> Self;
    /// Returns the absolute value.
    fn abs(self) -> Self;
    /// Returns the largest integer not above.
    fn floor(self) -> Self;
    /// Returns sine and cosine.
    fn sin_cos(self) -> (Self, Self);
    /// Returns the larger one; the other one if one is NaN.
    fn max(self, other: Self) -> Self;
    /// Returns the smaller one; the other one if one is NaN.
    fn min(self, other: Self) -> Self;

    /// Returns 1 / (1 + e^−x), finite for every x.
    fn sigmoid(self) -> Self {
        if self < Self::of(0.0) {
            let e = self.exp();
            e / (Self::of(1.0) + e)
        } else {
            Self::of(1.0) / (Self::of(1.0) + (-self).exp())
        }
    }

    /// Returns ln sigmoid(x) = min(x, 0) − ln(1 + e^−|x|), finite for every finite x.
    fn log_sigmoid(self) -> Self {
        self.min(Self::of(0.0)) - (-self.abs()).exp().ln_1p()
    }
}

macro_rules! real {
    ($t:ident) => {
        impl Real for $t {
            #[inline(always)]
            fn of(x: f64) -> Self {
                x as $t
            }
            #[inline(always)]
            fn to_f64(self) -> f64 {
                self as f64
            }
            #[inline(always)]
            fn exp(self) -> Self {
                $t::exp(self)
            }
            #[inline(always)]
            fn exp_m1(self) -> Self {
                $t::exp_m1(self)
            }
            #[inline(always)]
            fn ln_1p(self) -> Self {
                $t::ln_1p(self)
            }
            #[inline(always)]
            fn ln(self) -> Self {
                $t::ln(self)
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                $t::sqrt(self)
            }
            #[inline(always)]
            fn abs(self) -> Self {
                $t::abs(self)
            }
            #[inline(always)]
            fn floor(self) -> Self {
                $t::floor(self)
            }
            #[inline(always)]
            fn sin_cos(self) -> (Self, Self) {
                $t::sin_cos(self)
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                $t::max(self, other)
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                $t::min(self, other)
            }
        }
    };
}
real!(f32);
real!(f64);
