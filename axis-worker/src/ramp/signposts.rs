//! Where to look among sorted numbers: a search begins between two signposts, which stand so close that little is left to
//! search. It does not hold the numbers.

use std::ops::Range;

/// For each of some equal parts of the numbers' range, how many numbers lie before it.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Signposts {
    /// A part is so many bits long.
    bits: u32,
    before: Vec<u16>,
}

impl Signposts {
    /// For these numbers, in ascending order: about a part for each.
    pub(super) fn new(numbers: &[u64]) -> Self {
        let greatest = numbers.last().copied().unwrap_or(0);
        let bits = (greatest / (numbers.len() as u64).max(1)).checked_ilog2().unwrap_or(0);
        // One more ends the last part.
        let before = (0..=(greatest >> bits) + 1)
            .map(|part| numbers.partition_point(|number| number >> bits < part))
            .map(|before| u16::try_from(before).expect("at most as many rungs as entries of a table"))
            .collect();
        Self { bits, before }
    }

    /// Among the numbers with these indices begins what is greater than `key`, or not smaller; or where they end.
    #[inline]
    pub(super) fn around(&self, key: u64) -> Range<usize> {
        let last = self.before.len() - 2;
        let part = usize::try_from(key >> self.bits).map_or(last, |part| part.min(last));
        self.before[part].into()..self.before[part + 1].into()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_search_between_signposts_finds_what_a_search_everywhere_finds(
            mut numbers in prop_oneof![
                prop::collection::vec(0..10_000_u64, 0..240),
                prop::collection::vec(any::<u64>(), 0..240),
            ],
            key in prop_oneof![0..11_000_u64, any::<u64>()],
            at in any::<prop::sample::Index>(),
        ) {
            numbers.sort_unstable();
            let signposts = Signposts::new(&numbers);
            let near = (!numbers.is_empty()).then(|| numbers[at.index(numbers.len())]);
            let keys = near.into_iter().flat_map(|near| [near.saturating_sub(1), near, near.saturating_add(1)]);
            for key in keys.chain([key]) {
                let Range { start, end } = signposts.around(key);
                let among = &numbers[start..end];
                prop_assert_eq!(
                    start + among.partition_point(|number| *number <= key),
                    numbers.partition_point(|number| *number <= key)
                );
                prop_assert_eq!(
                    start + among.partition_point(|number| *number < key),
                    numbers.partition_point(|number| *number < key)
                );
            }
        }
    }
}
