//! Pins of a block as a table, from its source.

/// Inputs and outputs of a source file as a table in Markdown: pin, type, what it begins with, and its comment.
pub fn pins(text: &str) -> String {
    let mut rows = vec!["| pin | | type | begins with | |".to_owned(), "|---|---|---|---|---|".to_owned()];
    for (block, way) in [("VAR_INPUT", "in"), ("VAR_OUTPUT", "out")] {
        let Some((_, rest)) = text.split_once(&format!("{block}\n")) else { continue };
        let mut rest = rest.split_once("END_VAR").map_or("", |(within, _)| within).trim_start();
        while let Some((declaration, after)) = rest.split_once(';') {
            let (name, ty) = declaration.split_once(':').unwrap_or((declaration, ""));
            let (ty, initial) = ty.split_once(":=").unwrap_or((ty, ""));
            let after = after.trim_start_matches(' ');
            let (comment, after) = match after.strip_prefix("(*").and_then(|after| after.split_once("*)")) {
                Some((comment, after)) => (comment.split_whitespace().collect::<Vec<_>>().join(" "), after),
                None => (String::new(), after),
            };
            rows.push(format!("| {} | {way} | {} | {} | {comment} |", name.trim(), ty.trim(), initial.trim()));
            rest = after.trim_start();
        }
    }
    rows.join("\n")
}
