//! Rows under named columns, as Markdown and as CSV.

use surfelcast::Failure;

/// A table of text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Table {
    columns: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    pub(crate) fn new<T: Into<String>>(columns: impl IntoIterator<Item = T>) -> Self {
        Self { columns: columns.into_iter().map(Into::into).collect(), rows: Vec::new() }
    }

    /// Adds a row; cells that are missing at its end stay empty.
    pub(crate) fn push<T: Into<String>>(&mut self, cells: impl IntoIterator<Item = T>) {
        let mut row: Vec<String> = cells.into_iter().map(Into::into).collect();
        debug_assert!(row.len() <= self.columns.len(), "a row has a cell without a column: {row:?}");
        row.resize(self.columns.len(), String::new());
        self.rows.push(row);
    }

    pub(crate) fn markdown(&self) -> String {
        let line = |cells: &[String]| {
            let cells: Vec<_> = cells.iter().map(|cell| cell.replace('|', "\\|")).collect();
            format!("| {} |\n", cells.join(" | "))
        };
        let dashes = format!("|{}\n", "---|".repeat(self.columns.len()));
        line(&self.columns) + &dashes + &self.rows.iter().map(|row| line(row)).collect::<String>()
    }

    pub(crate) fn csv(&self) -> Result<Vec<u8>, Failure> {
        let failed = |error: &dyn std::fmt::Display| Failure::runtime(format!("a table is no CSV: {error}"));
        let mut writer = csv::Writer::from_writer(Vec::new());
        for row in std::iter::once(&self.columns).chain(&self.rows) {
            writer.write_record(row).map_err(|error| failed(&error))?;
        }
        writer.into_inner().map_err(|error| failed(&error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_forms_have_every_cell() {
        let mut table = Table::new(["a", "b"]);
        table.push(["1, 2", "x|y"]);
        table.push(["3"]);
        assert_eq!(table.markdown(), "| a | b |\n|---|---|\n| 1, 2 | x\\|y |\n| 3 |  |\n");
        assert_eq!(String::from_utf8(table.csv().unwrap()).unwrap(), "a,b\n\"1, 2\",x|y\n3,\n");
    }
}
