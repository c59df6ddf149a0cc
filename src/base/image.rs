//! Images as grids of texels, row by row from the top.

use std::ops::{Index, IndexMut};

/// Columns and rows of an image. Its texels are counted row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct ImageSize {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl ImageSize {
    /// So many columns and rows.
    pub fn new(width: usize, height: usize) -> ImageSize {
        ImageSize { width, height }
    }

    /// How many texels there are.
    pub fn texels(self) -> usize {
        self.width * self.height
    }

    /// Column and row of texel `k`.
    pub fn position(self, k: usize) -> [usize; 2] {
        [k % self.width, k / self.width]
    }

    /// Which texel is at this column and row, if one is.
    pub fn texel(self, [column, row]: [usize; 2]) -> Option<usize> {
        (column < self.width && row < self.height).then(|| row * self.width + column)
    }

    /// Columns and rows of all texels.
    pub fn positions(self) -> impl Iterator<Item = [usize; 2]> {
        (0..self.texels()).map(move |k| self.position(k))
    }

    /// The texels left, right, above and below of texel `k`, as far as they exist.
    pub fn neighbours(self, k: usize) -> impl Iterator<Item = usize> {
        let ([column, row], ImageSize { width, height }) = (self.position(k), self);
        [
            (column > 0).then(|| k - 1),
            (column + 1 < width).then_some(k + 1),
            (row > 0).then(|| k - width),
            (row + 1 < height).then_some(k + width),
        ]
        .into_iter()
        .flatten()
    }
}

/// One thing for each texel of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct Image<T> {
    /// Columns and rows.
    pub size: ImageSize,
    /// What the texels hold, row by row.
    pub pixels: Vec<T>,
}

impl<T> Image<T> {
    /// An image of these texels; none where there are more or fewer than the size says.
    pub fn new(size: ImageSize, pixels: Vec<T>) -> Option<Image<T>> {
        (pixels.len() == size.texels()).then_some(Image { size, pixels })
    }

    /// Makes the texels one after the other, from their columns and rows.
    pub fn of(size: ImageSize, make: impl FnMut([usize; 2]) -> T) -> Image<T> {
        Image { size, pixels: size.positions().map(make).collect() }
    }

    /// What is at this column and row, if the image reaches there.
    pub fn get(&self, at: [usize; 2]) -> Option<&T> {
        self.pixels.get(self.size.texel(at)?)
    }

    /// The rows from the top.
    pub fn rows(&self) -> impl Iterator<Item = &[T]> {
        self.pixels.chunks(self.size.width.max(1))
    }

    /// An image of what `make` gives for each texel.
    pub fn map<U>(self, make: impl FnMut(T) -> U) -> Image<U> {
        Image { size: self.size, pixels: self.pixels.into_iter().map(make).collect() }
    }
}

impl<T> Index<usize> for Image<T> {
    type Output = T;
    fn index(&self, k: usize) -> &T {
        &self.pixels[k]
    }
}

impl<T> IndexMut<usize> for Image<T> {
    fn index_mut(&mut self, k: usize) -> &mut T {
        &mut self.pixels[k]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_have_two_neighbours_and_the_inside_four() {
        let of = |k| ImageSize::new(3, 3).neighbours(k).collect::<Vec<_>>();
        assert_eq!((of(0), of(2), of(8)), (vec![1, 3], vec![1, 5], vec![7, 5]));
        assert_eq!(of(4), [3, 5, 1, 7]);
        assert_eq!(ImageSize::new(1, 1).neighbours(0).count(), 0);
    }

    #[test]
    fn texels_are_found_by_column_and_row() {
        let mut image = Image::of(ImageSize::new(3, 2), |[i, j]| 10 * j + i);
        assert_eq!((image.get([2, 1]), image.get([3, 0]), image.get([0, 2])), (Some(&12), None, None));
        assert!(image.size.positions().enumerate().all(|(k, at)| image.size.texel(at) == Some(k)));
        image[3] = 7;
        let doubled = image.map(|v| 2 * v);
        assert_eq!(doubled.rows().collect::<Vec<_>>(), [[0, 2, 4], [14, 22, 24]]);
        assert_eq!(Image::new(doubled.size, vec![0; 5]), None);
    }
}
