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

    /// The middle of texel `k`, in texels from the upper left corner.
    pub fn middle(self, k: usize) -> [f64; 2] {
        self.position(k).map(|v| v as f64 + 0.5)
    }

    /// The middle of texel `k` from that of the image (mm), where a texel is `texel_mm` wide: x to the right, y up.
    pub fn place_mm(self, texel_mm: f64, k: usize) -> [f64; 2] {
        let [i, j] = self.position(k).map(|v| v as f64);
        [(i + 0.5 - self.width as f64 / 2.0) * texel_mm, (self.height as f64 / 2.0 - j - 0.5) * texel_mm]
    }

    /// Which texel is at this column and row, if one is. Numbers with a sign may lie left of the image or above it.
    pub fn texel<N: TryInto<usize>>(self, at: [N; 2]) -> Option<usize> {
        let [Ok(column), Ok(row)] = at.map(TryInto::<usize>::try_into) else { return None };
        (column < self.width && row < self.height).then(|| row * self.width + column)
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
    /// Makes the texels one after the other, by their number.
    pub fn of(size: ImageSize, make: impl FnMut(usize) -> T) -> Image<T> {
        Image { size, pixels: (0..size.texels()).map(make).collect() }
    }

    /// What is at this column and row, if the image reaches there.
    pub fn get<N: TryInto<usize>>(&self, at: [N; 2]) -> Option<&T> {
        self.pixels.get(self.size.texel(at)?)
    }

    /// An image of what `make` gives for each texel of both.
    pub fn zip<U, V>(&self, other: &Image<U>, make: impl Fn(&T, &U) -> V) -> Image<V> {
        Image { size: self.size, pixels: self.pixels.iter().zip(&other.pixels).map(|(a, b)| make(a, b)).collect() }
    }
}

impl Image<f64> {
    /// The bilinear value between the middles of texels, which have whole numbers; clamped at the edges.
    pub fn bilinear(&self, column: f64, row: f64) -> f64 {
        let ImageSize { width, height } = self.size;
        let x = column.clamp(0.0, (width - 1) as f64);
        let y = row.clamp(0.0, (height - 1) as f64);
        let (i, j) = ((x as usize).min(width.saturating_sub(2)), (y as usize).min(height.saturating_sub(2)));
        let (i1, j1) = ((i + 1).min(width - 1), (j + 1).min(height - 1));
        let (fx, fy) = (x - i as f64, y - j as f64);
        let top = self[j * width + i] * (1.0 - fx) + self[j * width + i1] * fx;
        let low = self[j1 * width + i] * (1.0 - fx) + self[j1 * width + i1] * fx;
        top * (1.0 - fy) + low * fy
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
        let size = ImageSize::new(3, 2);
        assert_eq!((size.texels(), size.middle(5)), (6, [2.5, 1.5]));
        assert_eq!((size.place_mm(0.5, 0), size.place_mm(0.5, 5)), ([-0.5, 0.25], [0.5, -0.25]));
        let mut image = Image::of(size, |k| size.position(k)[0] + 10 * size.position(k)[1]);
        assert_eq!((image.get([2, 1]), image.get([3, 0]), image.get([0, 2])), (Some(&12), None, None));
        assert_eq!((image.get([-1, 1]), image.get([1, -1])), (None, None));
        assert!((0..6).all(|k| size.texel(size.position(k)) == Some(k)));
        image[3] = 7;
        assert_eq!(image.zip(&image, |a, b| a + b).pixels, [0, 2, 4, 14, 22, 24]);
    }

    #[test]
    fn values_between_texels_are_those_of_a_plane_and_end_at_the_edges() {
        let size = ImageSize::new(4, 3);
        let image = Image::of(size, |k| size.position(k)[0] as f64 + 10.0 * size.position(k)[1] as f64);
        assert!((image.bilinear(1.25, 0.5) - 6.25).abs() < 1e-12);
        assert_eq!((image.bilinear(-2.0, 9.0), image.bilinear(7.0, -1.0)), (20.0, 3.0));
    }
}
