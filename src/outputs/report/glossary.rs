//! The words and signs of a report, as the book's glossary explains them.

use serde::Serialize;

const PAGE: &str = include_str!("glossary.md");

/// A word and what it means.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GlossaryEntry {
    /// The word or sign.
    pub word: String,
    /// What it means, in a sentence or two.
    pub meaning: String,
}

/// All words of the glossary, in its order.
pub fn entries() -> Vec<GlossaryEntry> {
    let rows = PAGE.lines().filter_map(|line| line.strip_prefix("| ")?.strip_suffix(" |")?.split_once(" | "));
    let words = rows.filter(|(word, _)| *word != "word");
    words.map(|(word, meaning)| GlossaryEntry { word: plain(word), meaning: plain(meaning) }).collect()
}

/// The whole page, with its headings and tables but without other marks.
pub fn page() -> String {
    plain(PAGE)
}

/// Markdown without its marks: of a link, its words.
fn plain(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some((before, after)) = rest.split_once('[') {
        out += before;
        match after.split_once("](").and_then(|(words, link)| Some((words, link.split_once(')')?.1))) {
            Some((words, behind)) => {
                out += words;
                rest = behind;
            }
            None => {
                out.push('[');
                rest = after;
            }
        }
    }
    (out + rest).replace(['*', '`'], "")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_words_of_a_verdict_are_explained_without_marks() {
        let all = entries();
        for word in ["γ", "standard error", "held-out", "undetermined"] {
            assert!(all.iter().any(|e| e.word == word), "{word}");
        }
        assert!(all.iter().all(|e| !e.meaning.is_empty() && !format!("{e:?}").contains("](")), "{all:?}");
        assert_eq!(plain("the *reduced* [one](x.md#y), [not a link"), "the reduced one, [not a link");
    }
}
