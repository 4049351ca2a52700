//! The programs in the book: every one of them runs to its end on a set just switched on.

use super::bench::Rig;

/// The programs of a chapter, each with the line on which it begins.
fn programs(chapter: &str) -> Vec<(usize, String)> {
    let mut programs: Vec<(usize, String)> = Vec::new();
    let mut inside = false;
    for (line, text) in chapter.lines().enumerate() {
        match (inside, text) {
            (false, "```rhai") => {
                inside = true;
                programs.push((line + 2, String::new()));
            }
            (true, "```") => inside = false,
            (true, text) => {
                if let Some((_, program)) = programs.last_mut() {
                    program.push_str(text);
                    program.push('\n');
                }
            }
            (false, text) => assert!(
                !text.starts_with("```rust") && !text.starts_with("```rhai"),
                "line {}: a program that is not run",
                line + 1
            ),
        }
    }
    programs
}

#[test]
fn every_program_in_the_book_runs_to_its_end() {
    for (name, chapter, at_least) in [
        ("programs.md", include_str!("../../../../docs/src/guide/programs.md"), 3),
        ("language.md", include_str!("../../../../docs/src/guide/language.md"), 5),
    ] {
        let programs = programs(chapter);
        assert!(programs.len() >= at_least, "{name}: {} programs", programs.len());
        for (line, program) in programs {
            if let Err(error) = Rig::new().run(&program) {
                panic!("{name}, line {line}: {:?}", miette::Report::new(error));
            }
        }
    }
}
