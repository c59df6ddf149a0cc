//! One value for each of red, green and blue.

use serde::{Deserialize, Serialize};
use std::iter::Sum;
use std::ops::{Add, AddAssign, Deref, DerefMut, Div, DivAssign, Mul, MulAssign, Sub, SubAssign};

/// One value for each of red, green and blue: a colour, or anything that is computed for each channel alone. It can be
/// read wherever an array of three is. Points, normals and directions are arrays or vectors, because their parts mix.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Rgb<T = f64>(pub [T; 3]);

impl<T> Rgb<T> {
    /// Makes the value of each channel, red first.
    pub fn of(make: impl FnMut(usize) -> T) -> Rgb<T> {
        Rgb(std::array::from_fn(make))
    }

    /// The same value in each channel.
    pub fn splat(value: T) -> Rgb<T>
    where
        T: Copy,
    {
        Rgb([value; 3])
    }

    /// What `make` gives for each channel.
    pub fn map<U>(self, make: impl FnMut(T) -> U) -> Rgb<U> {
        Rgb(self.0.map(make))
    }

    /// What `make` gives for each channel of both.
    pub fn zip<U: Copy, V>(self, other: Rgb<U>, mut make: impl FnMut(T, U) -> V) -> Rgb<V> {
        let mut c = 0;
        self.map(|value| {
            c += 1;
            make(value, other.0[c - 1])
        })
    }

    /// The sum of the channels, red first.
    pub fn sum(self) -> T
    where
        T: Sum,
    {
        self.0.into_iter().sum()
    }
}

impl<A: Copy, B: Copy> Rgb<(A, B)> {
    /// The first of each channel's pair, and the second.
    pub fn unzip(self) -> (Rgb<A>, Rgb<B>) {
        (self.map(|pair| pair.0), self.map(|pair| pair.1))
    }
}

impl<T> Deref for Rgb<T> {
    type Target = [T; 3];
    fn deref(&self) -> &[T; 3] {
        &self.0
    }
}

impl<T> DerefMut for Rgb<T> {
    fn deref_mut(&mut self) -> &mut [T; 3] {
        &mut self.0
    }
}

impl<T> From<[T; 3]> for Rgb<T> {
    fn from(channels: [T; 3]) -> Rgb<T> {
        Rgb(channels)
    }
}

impl<T> From<Rgb<T>> for [T; 3] {
    fn from(rgb: Rgb<T>) -> [T; 3] {
        rgb.0
    }
}

impl<T> IntoIterator for Rgb<T> {
    type Item = T;
    type IntoIter = std::array::IntoIter<T, 3>;
    fn into_iter(self) -> Self::IntoIter {
        self.0.into_iter()
    }
}

impl<'a, T> IntoIterator for &'a Rgb<T> {
    type Item = &'a T;
    type IntoIter = std::slice::Iter<'a, T>;
    fn into_iter(self) -> Self::IntoIter {
        self.0.iter()
    }
}

impl<'a, T> IntoIterator for &'a mut Rgb<T> {
    type Item = &'a mut T;
    type IntoIter = std::slice::IterMut<'a, T>;
    fn into_iter(self) -> Self::IntoIter {
        self.0.iter_mut()
    }
}

macro_rules! channel_by_channel {
    ($operator:ident, $method:ident, $assigning:ident, $assign:ident) => {
        impl<T: Copy + $operator<Output = T>> $operator for Rgb<T> {
            type Output = Rgb<T>;
            #[inline]
            fn $method(self, other: Rgb<T>) -> Rgb<T> {
                self.zip(other, T::$method)
            }
        }

        impl<T: Copy + $operator<Output = T>> $operator<T> for Rgb<T> {
            type Output = Rgb<T>;
            #[inline]
            fn $method(self, other: T) -> Rgb<T> {
                self.map(|value| value.$method(other))
            }
        }

        impl $operator<Rgb<f64>> for f64 {
            type Output = Rgb<f64>;
            #[inline]
            fn $method(self, other: Rgb<f64>) -> Rgb<f64> {
                other.map(|value| self.$method(value))
            }
        }

        impl<T: Copy, U> $assigning<U> for Rgb<T>
        where
            Rgb<T>: $operator<U, Output = Rgb<T>>,
        {
            #[inline]
            fn $assign(&mut self, other: U) {
                *self = self.$method(other);
            }
        }
    };
}

channel_by_channel!(Add, add, AddAssign, add_assign);
channel_by_channel!(Sub, sub, SubAssign, sub_assign);
channel_by_channel!(Mul, mul, MulAssign, mul_assign);
channel_by_channel!(Div, div, DivAssign, div_assign);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_do_not_mix() {
        let (a, b) = (Rgb([1.0, 2.0, 4.0]), Rgb([8.0, 0.5, 0.25]));
        assert_eq!(a * b + 1.0, Rgb([9.0, 2.0, 2.0]));
        assert_eq!((a - b) / b, Rgb([-0.875, 3.0, 15.0]));
        assert_eq!(2.0 - a, Rgb([1.0, 0.0, -2.0]));
        assert_eq!(a.zip(Rgb(["x", "y", "z"]), |v, name| format!("{name}{v}")).0, ["x1", "y2", "z4"]);
        let mut c = Rgb::splat(1.0);
        c += a;
        c *= b;
        c *= 2.0;
        assert_eq!(c, Rgb::of(|k| 2.0 * (1.0 + a[k]) * b[k]));
        c -= 1.0;
        c /= b;
        assert_eq!(c, Rgb::of(|k| (2.0 * (1.0 + a[k]) * b[k] - 1.0) / b[k]));
    }

    #[test]
    fn pairs_come_apart_and_channels_are_summed() {
        let (first, second) = Rgb([(1, "x"), (2, "y"), (4, "z")]).unzip();
        assert_eq!((first.sum(), second.0), (7, ["x", "y", "z"]));
    }

    #[test]
    fn a_file_holds_a_list_of_three() {
        #[derive(Debug, PartialEq, Serialize, Deserialize)]
        struct Row {
            colour: Rgb,
        }
        let row = Row { colour: Rgb([0.5, 0.25, 1.5]) };
        let text = toml::to_string(&row).unwrap();
        assert_eq!(text.trim(), "colour = [0.5, 0.25, 1.5]");
        assert_eq!(toml::from_str::<Row>(&text).unwrap(), row);
    }
}
