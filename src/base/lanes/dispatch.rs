//! The one place where a function that is compiled for an instruction set is entered.

use super::array::ArrayLanes;
#[cfg(target_arch = "x86_64")]
use super::x86::{DoublesAvx2, DoublesAvx512, SinglesAvx2};
use super::{DoubleLanes, SingleLanes, WIDTH};
use crate::processor::InstructionSet;

/// The vectors of an instruction set.
pub trait LaneSet {
    /// Of f64.
    type F64: DoubleLanes;
    /// Of f32.
    type F32: SingleLanes;
}

/// The largest set for which there are vectors of a type.
pub mod widest {
    use crate::processor::InstructionSet;
    /// Of f64.
    pub const F64: InstructionSet = InstructionSet::Avx512;
    /// Of f32. Loops that leave the choice of instructions to the compiler take these, too.
    pub const F32: InstructionSet = InstructionSet::Avx2;
}

/// Work that is done with vectors of any kind.
pub trait LaneJob {
    /// The largest set that it is compiled for.
    const WIDEST: InstructionSet;
    /// What it gives.
    type Output;
    /// Does it; `#[inline(always)]`, so that it is compiled for the vectors' instruction set.
    fn run<S: LaneSet>(self) -> Self::Output;
}

struct Plain;
impl LaneSet for Plain {
    type F64 = ArrayLanes<f64, 4>;
    type F32 = ArrayLanes<f32, WIDTH>;
}

#[cfg(target_arch = "x86_64")]
struct Avx2;
#[cfg(target_arch = "x86_64")]
impl LaneSet for Avx2 {
    type F64 = DoublesAvx2;
    type F32 = SinglesAvx2;
}

#[cfg(target_arch = "x86_64")]
struct Avx512;
#[cfg(target_arch = "x86_64")]
impl LaneSet for Avx512 {
    type F64 = DoublesAvx512;
    type F32 = SinglesAvx2;
}

/// Does `job` with the vectors of `set`, or of the largest set that the processor has.
#[inline]
pub fn dispatch<J: LaneJob>(set: InstructionSet, job: J) -> J::Output {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2,fma,bmi1")]
        fn avx2<J: LaneJob>(job: J) -> J::Output {
            job.run::<Avx2>()
        }
        #[target_feature(enable = "avx512f,bmi1")]
        fn avx512<J: LaneJob>(job: J) -> J::Output {
            job.run::<Avx512>()
        }
        let set = set.or_less();
        if const { matches!(J::WIDEST, InstructionSet::Avx512) } && set == InstructionSet::Avx512 {
            // SAFETY: `or_less` gives only what this processor has.
            return unsafe { avx512(job) };
        }
        if set >= InstructionSet::Avx2 {
            // SAFETY: as above.
            return unsafe { avx2(job) };
        }
    }
    let _ = set;
    job.run::<Plain>()
}

/// Compiles a generic `#[inline(always)]` function for each instruction set and calls the one of `set` by
/// [`dispatch`]: `dispatch_lanes!(set, F64, function(arg: Type, …) -> Return)`. `F64` or `F32` says which vectors are
/// the function's first type; flags and types that follow it stand in brackets:
/// `dispatch_lanes!(set, F32[ANY][F: Found], search(found: &mut F) -> bool)`.
#[macro_export]
macro_rules! dispatch_lanes {
    ($set:expr, $lanes:ident, $function:ident($($arg:ident : $type:ty),* $(,)?) $(-> $out:ty)?) => {
        $crate::dispatch_lanes!($set, $lanes[][], $function($($arg: $type),*) $(-> $out)?)
    };
    (
        $set:expr, $lanes:ident[$($flag:ident),*][$($generic:ident: $bound:path),*],
        $function:ident($($arg:ident : $type:ty),* $(,)?)
    ) => {
        $crate::dispatch_lanes!($set, $lanes[$($flag),*][$($generic: $bound),*], $function($($arg: $type),*) -> ())
    };
    (
        $set:expr, $lanes:ident[$($flag:ident),*][$($generic:ident: $bound:path),*],
        $function:ident($($arg:ident : $type:ty),* $(,)?) -> $out:ty
    ) => {{
        struct Call<T, $(const $flag: bool),*>(T);
        impl<$(const $flag: bool,)* $($generic: $bound),*> $crate::lanes::LaneJob for Call<($($type,)*), $($flag),*> {
            const WIDEST: $crate::processor::InstructionSet = $crate::lanes::widest::$lanes;
            type Output = $out;
            #[inline(always)]
            fn run<S: $crate::lanes::LaneSet>(self) -> $out {
                let ($($arg,)*) = self.0;
                $function::<S::$lanes, $($flag,)* $($generic),*>($($arg),*)
            }
        }
        $(let $arg: $type = $arg;)*
        $crate::lanes::dispatch($set, Call::<_, $($flag),*>(($($arg,)*)))
    }};
}
