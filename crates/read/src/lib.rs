//! Reads *plain* CSV fast: blocks of complete lines into columns of numbers, times and words.
//!
//! Plain is what nearly all recordings are: one-byte separator, decimal point, no quotes, no spaces around values, ISO
//! times without a zone or in UTC. A block that is anything else in any place is handed back whole, for a reader that
//! knows all spellings and tells a person which cell is wrong. So there is one set of rules and one set of messages, and
//! this is a short cut through them: the same values, to the bit, or none.

use memchr::memchr2;

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Decimal numbers; an empty cell is NaN.
    Number,
    /// `YYYY-MM-DD hh:mm:ss`, with `T` for the space and with a fraction where there is one.
    Time,
    /// The same with a `Z` behind.
    TimeUtc,
    /// Few different words over and over, such as a mode.
    Word,
}

/// A column of one block.
#[derive(Clone, Debug, PartialEq)]
pub enum Column {
    /// Numbers.
    Numbers(Vec<f64>),
    /// Nanoseconds since 1970, of the clock on the wall where the time has no zone.
    Times(Vec<i64>),
    /// The different words, and for each row the place of its word among them.
    Words(Vec<String>, Vec<i32>),
}

/// More different words than this in one block, and it is no column of modes.
const MOST_WORDS: usize = 64;

/// How the lines of a file are made.
#[derive(Clone, Debug)]
pub struct Layout {
    separator: u8,
    kinds: Vec<Option<Kind>>,
}

impl Layout {
    /// `kinds` of all the columns of a line, `None` for those that are not wanted.
    pub fn new(separator: u8, kinds: Vec<Option<Kind>>) -> Self {
        Self { separator, kinds }
    }

    /// The wanted columns of a block of complete lines, without its first `skip` lines; `None` where it is not plain.
    pub fn parse(&self, block: &[u8], skip: usize) -> Option<Vec<Column>> {
        let mut rest = block;
        for _ in 0..skip {
            let (line, after) = rest.split_at(memchr::memchr(b'\n', rest)? + 1);
            // A lone '\r' ends a line too: whoever counts lines by '\n' would skip a row of data.
            if memchr::memchr(b'\r', line).is_some_and(|place| place + 2 != line.len()) {
                return None;
            }
            rest = after;
        }
        let line = memchr::memchr(b'\n', rest).unwrap_or(rest.len()).max(1);
        let rows = rest.len() / line + 1;
        let mut columns: Vec<Reader> = self.kinds.iter().map(|kind| Reader::new(*kind, rows)).collect();
        let (last, others) = columns.split_last_mut()?;
        while !rest.is_empty() {
            for column in &mut *others {
                rest = column.take(rest, self.separator)?;
                rest = rest.strip_prefix(&[self.separator])?;
            }
            rest = last.take(rest, self.separator)?;
            rest = match rest {
                [] => rest,
                [b'\n', rest @ ..] | [b'\r', b'\n', rest @ ..] => rest,
                _ => return None,
            };
        }
        Some(columns.into_iter().filter_map(|reader| reader.done).collect())
    }
}

/// Reads one column, cell by cell.
struct Reader {
    done: Option<Column>,
    utc: bool,
    /// The date before, as it was written and as days since 1970: it is mostly the same again.
    date: ([u8; 10], i64),
    code: i32,
}

impl Reader {
    fn new(kind: Option<Kind>, rows: usize) -> Self {
        let done = kind.map(|kind| match kind {
            Kind::Number => Column::Numbers(Vec::with_capacity(rows)),
            Kind::Time | Kind::TimeUtc => Column::Times(Vec::with_capacity(rows)),
            Kind::Word => Column::Words(Vec::new(), Vec::with_capacity(rows)),
        });
        Self { done, utc: kind == Some(Kind::TimeUtc), date: (*b"1970-01-01", 0), code: 0 }
    }

    /// Takes the cell at the beginning of `text`; gives what follows it.
    #[inline(always)]
    fn take<'a>(&mut self, text: &'a [u8], separator: u8) -> Option<&'a [u8]> {
        match &mut self.done {
            Some(Column::Numbers(numbers)) => {
                let (x, rest) = number(text, separator)?;
                numbers.push(x);
                Some(rest)
            }
            Some(Column::Times(times)) => {
                let (t, rest) = time(text, self.utc, &mut self.date)?;
                times.push(t);
                Some(rest)
            }
            Some(Column::Words(words, codes)) => {
                let (cell, rest) = cell(text, separator)?;
                if words.get(self.code as usize).is_none_or(|word| word.as_bytes() != cell) {
                    self.code = code(words, cell)?;
                }
                codes.push(self.code);
                Some(rest)
            }
            None => cell(text, separator).map(|(_, rest)| rest),
        }
    }
}

/// The cell as it is, up to the separator or the end of the line.
#[inline(always)]
fn cell(text: &[u8], separator: u8) -> Option<(&[u8], &[u8])> {
    let end = memchr2(separator, b'\n', text).unwrap_or(text.len());
    let (cell, mut rest) = text.split_at(end);
    let cell = match cell {
        [before @ .., b'\r'] if rest.first() != Some(&separator) => {
            rest = &text[end - 1..];
            before
        }
        _ => cell,
    };
    // A quote, or an empty line where a row should be, is for the reader that knows what they mean.
    if cell.contains(&b'"') || cell.contains(&b'\r') { None } else { Some((cell, rest)) }
}

#[cold]
fn code(words: &mut Vec<String>, cell: &[u8]) -> Option<i32> {
    let place = match words.iter().position(|word| word.as_bytes() == cell) {
        Some(place) => place,
        None if words.len() < MOST_WORDS => {
            words.push(std::str::from_utf8(cell).ok()?.to_owned());
            words.len() - 1
        }
        None => return None,
    };
    Some(place as i32)
}

#[inline(always)]
fn number(text: &[u8], separator: u8) -> Option<(f64, &[u8])> {
    let starts = |text: &[u8]| matches!(text, [b'0'..=b'9', ..] | [b'.', b'0'..=b'9', ..]);
    if !starts(text.strip_prefix(b"-").unwrap_or(text)) {
        // Only an empty cell; "NaN", "Bad" and "+1" have their own rules elsewhere.
        let empty = matches!(text, [] | [b'\n', ..] | [b'\r', b'\n', ..]) || text.first() == Some(&separator);
        return empty.then_some((f64::NAN, text));
    }
    let (x, used) = fast_float2::parse_partial::<f64, _>(text).ok()?;
    x.is_finite().then_some((x, &text[used..]))
}

#[inline(always)]
fn time<'a>(text: &'a [u8], utc: bool, date: &mut ([u8; 10], i64)) -> Option<(i64, &'a [u8])> {
    let (day, clock) = text.split_first_chunk::<10>()?;
    if *day != date.0 {
        *date = (*day, days(day)?);
    }
    let (clock, mut rest) = clock.split_first_chunk::<9>()?;
    let &[b' ' | b'T', h1, h2, b':', m1, m2, b':', s1, s2] = clock else { return None };
    let (hour, minute, second) = (two(h1, h2)?, two(m1, m2)?, two(s1, s2)?);
    if hour > 23 || minute > 59 || second > 59 {
        return None;
    }
    let mut nanoseconds = 0;
    if let Some(fraction) = rest.strip_prefix(b".") {
        let digits = fraction.iter().take(10).take_while(|digit| digit.is_ascii_digit()).count();
        if !(1..=9).contains(&digits) {
            return None;
        }
        let number = fraction[..digits].iter().fold(0, |number, digit| 10 * number + i64::from(digit - b'0'));
        nanoseconds = number * 10_i64.pow(9 - digits as u32);
        rest = &fraction[digits..];
    }
    if utc {
        rest = rest.strip_prefix(b"Z")?;
    }
    let seconds = ((date.1 * 24 + hour) * 60 + minute) * 60 + second;
    Some((seconds * 1_000_000_000 + nanoseconds, rest))
}

#[inline(always)]
fn two(tens: u8, ones: u8) -> Option<i64> {
    (tens.is_ascii_digit() && ones.is_ascii_digit()).then(|| i64::from(tens - b'0') * 10 + i64::from(ones - b'0'))
}

/// Days from 1970-01-01 to a date of the Gregorian calendar, in the years in which nanoseconds fit 64 bits.
#[cold]
fn days(date: &[u8; 10]) -> Option<i64> {
    let &[y1, y2, y3, y4, b'-', m1, m2, b'-', d1, d2] = date else { return None };
    let (year, month, day) = (two(y1, y2)? * 100 + two(y3, y4)?, two(m1, m2)?, two(d1, d2)?);
    let leap = (year % 4 == 0 && year % 100 != 0) || year % 400 == 0;
    let lengths = [31, if leap { 29 } else { 28 }, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let length = *lengths.get(usize::try_from(month - 1).ok()?)?;
    if !(1700..=2200).contains(&year) || !(1..=length).contains(&day) {
        return None;
    }
    let before = year - 1;
    let to_year = before * 365 + before / 4 - before / 100 + before / 400;
    let to_month: i64 = lengths[..(month - 1) as usize].iter().sum();
    const TO_1970: i64 = 719_162; // the same sum for 1969
    Some(to_year + to_month + day - 1 - TO_1970)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn layout() -> Layout {
        Layout::new(b',', vec![Some(Kind::Time), Some(Kind::Number), None, Some(Kind::Word)])
    }

    #[test]
    fn columns_of_a_plain_block() {
        let text = b"t,PV,x,MODE\r\n2026-03-01 00:00:00.5,1.25,foo,AUTO\r\n1970-01-02T00:00:01,,,MAN\r\n";
        let columns = layout().parse(text, 1).unwrap();
        assert_eq!(columns[0], Column::Times(vec![1_772_323_200_500_000_000, 86_401_000_000_000]));
        let Column::Numbers(numbers) = &columns[1] else { panic!() };
        assert!(numbers[0] == 1.25 && numbers[1].is_nan());
        assert_eq!(columns[2], Column::Words(vec!["AUTO".into(), "MAN".into()], vec![0, 1]));
    }

    #[test]
    fn what_is_not_plain_is_handed_back() {
        for line in [
            "2026-03-01 00:00:00,1,x",          // ragged
            "2026-03-01 00:00:00,1,x,AUTO,y",   // ragged
            "2026-03-01 00:00:00,\"1\",x,AUTO", // quoted
            "2026-03-01 00:00:00, 1,x,AUTO",    // space
            "2026-03-01 00:00:00,+1,x,AUTO",    // sign
            "2026-03-01 00:00:00,-inf,x,AUTO",  // infinity
            "2026-03-01 00:00:00,1e999,x,AUTO", // too large
            "2026-03-01 00:00:00,1.5.2,x,AUTO", // two points
            "2026-03-01 00:00:00,Bad,x,AUTO",   // word
            "2026-02-29 00:00:00,1,x,AUTO",     // no leap year
            "2026-13-01 00:00:00,1,x,AUTO",     // month
            "2026-03-01 24:00:00,1,x,AUTO",     // hour
            "2026-03-01 00:00:00Z,1,x,AUTO",    // zone
            "2026-03-01 00:00,1,x,AUTO",        // no seconds
            "2026-03-01 00:00:00.,1,x,AUTO",    // no fraction
            ",1,x,AUTO",                        // no time
            "\n2026-03-01 00:00:00,1,x,AUTO",   // empty line
        ] {
            assert_eq!(layout().parse(line.as_bytes(), 0), None, "{line:?}");
        }
        assert_eq!(layout().parse(b"one line", 1), None);
        assert_eq!(layout().parse(b"\0\0\0\0\0\0\0\0\0\0 00:00:00,1,x,AUTO", 0), None);
        assert_eq!(layout().parse(b"a title\rt,PV,x,MODE\n2026-03-01 00:00:00,1,x,AUTO\n", 1), None);
    }

    proptest! {
        #[test]
        fn never_panics(bytes in prop::collection::vec(any::<u8>(), 0..200), skip in 0usize..3) {
            layout().parse(&bytes, skip);
        }

        #[test]
        fn never_panics_on_nearly_plain(text in "(20[0-9]{2}-[01][0-9]-[0-3][0-9][ T][0-2][0-9]:[0-5][0-9]:[0-5][0-9](\\.[0-9]{0,11})?,-?[0-9.e]{0,6},[a-z\"\r]{0,3},[A-Z]{0,3}\r?\n?){0,4}") {
            layout().parse(text.as_bytes(), 0);
        }

        #[test]
        fn numbers_come_back(x in any::<f64>().prop_filter("finite", |x| x.is_finite())) {
            let text = format!("2026-03-01 00:00:00,{x:e},,A\n");
            let columns = layout().parse(text.as_bytes(), 0).unwrap();
            prop_assert_eq!(&columns[1], &Column::Numbers(vec![x]));
        }
    }
}
