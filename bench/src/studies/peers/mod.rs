//! Seconds to an error next to those of other renderers, from an empty cache and from a warm one.

mod figures;

use std::path::PathBuf;

use clap::Args;
use surfelcast::Failure;

use crate::report::{Page, Table};
use crate::studies::curves::{
    self, Curve, CurvesArgs, GOALS, Question, Start, Variant, VariantLists, by_case, conditions, reached,
};
use figures::Peers;

pub(super) const QUESTION: Question = Question {
    page: Page { name: "peers", template: include_str!("../../../pages/peers.md.in") },
    samples: 256,
    replicates: 2,
    scenes: &[],
    built_in: &[],
    size: None,
    is_indirect: false,
    variants,
};

#[derive(Debug, Args)]
pub(crate) struct PeersArgs {
    /// Seconds of other renderers: rows of their harness as CSV, or its tables as Markdown; may be given several
    /// times. The first file that has a figure counts.
    #[arg(long = "peers", value_name = "FILE")]
    peers: Vec<PathBuf>,
    #[command(flatten)]
    curves: CurvesArgs,
}

pub(super) fn run(args: &PeersArgs) -> Result<(), Failure> {
    let peers = Peers::read(&args.peers)?;
    curves::run(&QUESTION, &args.curves, |curves| table(curves, &peers))
}

fn variants(requested: &VariantLists) -> Result<Vec<Variant>, Failure> {
    let mut lists = requested.with_one_reconstruction();
    if requested.starts.is_empty() {
        lists.starts = vec![Start::Empty, Start::Warm];
    }
    lists.all()
}

/// Our seconds to each error next to theirs.
fn table(curves: &[Curve], peers: &Peers) -> String {
    let mut ours: Vec<String> = Vec::new();
    for curve in curves {
        let label = curve.key.variant.label();
        if !ours.contains(&label) {
            ours.push(label);
        }
    }
    let heads = ["image", "RMSE"].into_iter().map(str::to_owned);
    let mut table = Table::new(heads.chain(ours.iter().cloned()).chain(peers.names.iter().cloned()));
    for (case, of_case) in by_case(curves) {
        // Their figures hold for the image of the reference, at its size.
        let is_theirs = of_case.iter().all(|curve| curve.key.truth == case);
        for (index, goal) in GOALS.iter().enumerate() {
            let head = [if index == 0 { case } else { "" }.to_owned(), goal.to_string()];
            let mine = ours.iter().map(|label| {
                let curve = of_case.iter().find(|curve| curve.key.variant.label() == *label);
                reached(curve.and_then(|curve| curve.secs_to(*goal)), 1.0)
            });
            let theirs = peers.names.iter().map(|peer| {
                let times = peers.times_of(case, peer).filter(|_| is_theirs);
                times.map_or_else(|| "-".to_owned(), |times| times[index].clone())
            });
            table.push(head.into_iter().chain(mine).chain(theirs));
        }
    }
    conditions(curves) + &table.markdown()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::studies::curves::curve;

    #[test]
    fn figures_stand_next_to_the_same_image() {
        let mut peers = Peers::default();
        peers.add_rows(figures::tests::ROWS, Path::new("rows.csv")).unwrap();
        peers.add_tables(figures::tests::TABLE, Path::new("table.md")).unwrap();
        let mut curves = [curve("box_main_lambert", "path", 0.5)];
        assert!(!table(&curves, &peers).contains("1.77"), "another image than theirs");
        curves[0].key.truth = "box_main_lambert".to_owned();
        let text = table(&curves, &peers);
        assert!(text.contains("| box_main_lambert | 0.03 | 5.56 | 1.77 | <0.25* |"), "{text}");
        assert!(text.contains("|  | 0.02 | 12.5 | 3.96 |  |"), "{text}");
        assert!(text.contains("|  | 0.01 | >32.0 | ~15.8 | >4* |"), "{text}");
    }
}
