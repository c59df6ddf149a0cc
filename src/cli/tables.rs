//! The forms of the tables that verbs read and write, as `docs/tables.md` has them: each verb's `--help` shows its own
//! section of that page.

const PAGE: &str = include_str!("../../docs/tables.md");

/// The section of a verb (`fit slab`), as plain text for its help; empty where the page has none.
pub fn help(verb: &str) -> String {
    let heading = format!("## `{verb}`");
    let lines = PAGE.lines().skip_while(|line| !line.starts_with(&heading)).skip(1);
    plain(&lines.take_while(|line| !line.starts_with("## ")).collect::<Vec<_>>())
}

/// Markdown as it is shown in a terminal: tables in aligned columns, blocks of files and commands indented, and no
/// marks for bold text.
pub(super) fn plain(lines: &[&str]) -> String {
    let mut out = String::new();
    let mut k = 0;
    while k < lines.len() {
        let line = lines[k];
        if line.starts_with("```") {
            let end = lines[k + 1..].iter().position(|l| l.starts_with("```")).map_or(lines.len(), |n| k + 1 + n);
            lines[k + 1..end].iter().for_each(|l| out += &format!("  {l}\n"));
            k = end + 1;
        } else if line.starts_with('|') {
            let end = lines[k..].iter().position(|l| !l.starts_with('|')).map_or(lines.len(), |n| k + n);
            out += &aligned(&lines[k..end]);
            k = end;
        } else {
            out += &format!("{}\n", line.trim_start_matches('#').trim_start().replace("**", ""));
            k += 1;
        }
    }
    out.trim().to_string()
}

/// A Markdown table without its rules; each column is as wide as its widest cell.
fn aligned(lines: &[&str]) -> String {
    let cells = |line: &str| line.trim_matches('|').split('|').map(|c| c.trim().replace('`', "")).collect::<Vec<_>>();
    let rows: Vec<Vec<String>> =
        lines.iter().map(|l| cells(l)).filter(|row| row.iter().any(|c| !c.trim_matches('-').is_empty())).collect();
    let width = |column: usize| rows.iter().filter_map(|r| r.get(column)).map(|c| c.chars().count()).max().unwrap_or(0);
    let mut out = String::new();
    for row in &rows {
        let padded = row.iter().enumerate().map(|(k, cell)| format!("{cell:<w$}", w = width(k)));
        out += &format!("  {}\n", padded.collect::<Vec<_>>().join("  ").trim_end());
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markdown_reads_as_plain_text() {
        let page = [
            "Columns **in**:",
            "",
            "| column | unit |",
            "|---|---|",
            "| `rho_d` | 1 |",
            "",
            "```csv",
            "a,b",
            "```",
            "### More",
        ];
        assert_eq!(plain(&page), "Columns in:\n\n  column  unit\n  rho_d   1\n\n  a,b\nMore");
    }
}
