//! Images as grids of texels.

/// Indices of the texels left, right, above and below of texel `at` of a row-major image, as far as they exist.
pub fn neighbours(at: usize, width: usize, height: usize) -> impl Iterator<Item = usize> {
    let (i, j) = (at % width, at / width);
    [
        (i > 0).then(|| at - 1),
        (i + 1 < width).then_some(at + 1),
        (j > 0).then(|| at - width),
        (j + 1 < height).then_some(at + width),
    ]
    .into_iter()
    .flatten()
}

#[cfg(test)]
mod tests {
    use super::neighbours;

    #[test]
    fn corners_have_two_and_the_inside_four() {
        let of = |at| neighbours(at, 3, 3).collect::<Vec<_>>();
        assert_eq!((of(0), of(2), of(8)), (vec![1, 3], vec![1, 5], vec![7, 5]));
        assert_eq!(of(4), [3, 5, 1, 7]);
        assert_eq!(neighbours(0, 1, 1).count(), 0);
    }
}
