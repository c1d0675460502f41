//! Numbers as a person writes them, half to even as Python rounds.

const DASH: &str = "–";
/// A wider number needs an exponent; a narrower one too.
const PLAIN: std::ops::Range<i32> = -4..6;

/// A number with a fixed number of decimals.
pub(super) fn fixed(x: f64, places: usize) -> String {
    named(x).unwrap_or_else(|| format!("{x:.places$}"))
}

/// A number with so many places behind the point, times a power of ten of two digits or more.
pub(super) fn scientific(x: f64, places: usize) -> String {
    named(x).unwrap_or_else(|| powered(&format!("{x:.places$e}")))
}

/// A number with so many significant digits, zeros at the end left out.
pub(super) fn general(x: f64, digits: usize) -> String {
    if let Some(named) = named(x) {
        return named;
    }
    if x == 0.0 {
        return format!("{x}");
    }
    let last = digits.max(1) - 1;
    let rounded = format!("{x:.last$e}");
    let (mantissa, power) = rounded.split_once('e').unwrap_or((&rounded, "0"));
    let power: i32 = power.parse().unwrap_or(0);
    if power < PLAIN.start || power > last as i32 {
        return powered(&format!("{}e{power}", bare(mantissa)));
    }
    bare(&fixed(x, (last as i32 - power) as usize)).into()
}

/// The text for infinite numbers and NaN.
fn named(x: f64) -> Option<String> {
    match x {
        x if x.is_nan() => Some("nan".into()),
        x if x.is_infinite() => Some(if x > 0.0 { "inf" } else { "-inf" }.into()),
        _ => None,
    }
}

/// A number's text without needless zeros.
fn bare(text: &str) -> &str {
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { text }
}

/// Rewrites an exponent: `1.2e5` as `1.2e+05`.
fn powered(text: &str) -> String {
    let Some((mantissa, power)) = text.split_once('e') else { return text.into() };
    let (sign, power) = power.strip_prefix('-').map_or(('+', power), |power| ('-', power));
    format!("{mantissa}e{sign}{power:0>2}")
}

/// A number with so many significant digits, without an exponent where a person would use none; a dash where there is none.
///
/// ```
/// use glapp_analysis::words::number;
/// let told = [Some(0.50349), Some(1234.6), Some(34.0), None, Some(-0.00001234)].map(|x| number(x, 3));
/// assert_eq!(told, ["0.503", "1235", "34", "–", "−1.23e-05"]);
/// ```
pub fn number(value: Option<f64>, digits: usize) -> String {
    let Some(x) = value.filter(|x| x.is_finite()) else { return DASH.into() };
    if x == 0.0 {
        return "0".into();
    }
    let exponent = libm::floor(libm::log10(x.abs())) as i32;
    let text = if !PLAIN.contains(&exponent) {
        scientific(x, digits.max(1) - 1)
    } else if x.fract() == 0.0 {
        fixed(x, 0)
    } else {
        fixed(x, (digits as i32 - 1 - exponent).max(0) as usize)
    };
    text.strip_prefix('-').map_or(text.clone(), |size| format!("−{size}"))
}

/// A number with its unit, a no-break space between; a dash alone where there is no number.
pub fn quantity(value: Option<f64>, unit: &str, digits: usize) -> String {
    let text = number(value, digits);
    if text == DASH || unit.is_empty() { text } else { format!("{text}\u{a0}{unit}") }
}

/// A time span [s] in the two largest units that fit.
///
/// ```
/// use glapp_analysis::words::duration;
/// assert_eq!([48.0, 7500.0, 200_000.0].map(duration), ["48\u{a0}s", "2 h 5 min", "2 d 8 h"]);
/// ```
pub fn duration(seconds: f64) -> String {
    if !seconds.is_finite() || seconds < 120.0 {
        return quantity(Some(seconds), "s", 3);
    }
    let whole = |x: f64| libm::rint(x) as i64;
    let minutes = whole(seconds / 60.0);
    if minutes < 60 {
        return format!("{minutes} min");
    }
    let two = |many: i64, unit: &str, few: i64, small: &str| {
        if few == 0 { format!("{many} {unit}") } else { format!("{many} {unit} {few} {small}") }
    };
    let (hours, minutes) = (minutes / 60, minutes % 60);
    if hours < 48 {
        return two(hours, "h", minutes, "min");
    }
    let hours = hours + whole(minutes as f64 / 60.0);
    two(hours / 24, "d", hours % 24, "h")
}

/// A moment of a recording: local date and time where that of t = 0 is known [µs since 1970], else seconds.
///
/// ```
/// use glapp_analysis::words::clock;
/// assert_eq!(clock(Some(1_772_366_400_000_000), 90.0), "2026-03-01 12:01:30");
/// assert_eq!(clock(None, 90.0), "90 s");
/// ```
pub fn clock(t0: Option<i64>, seconds: f64) -> String {
    dated(t0, seconds).unwrap_or_else(|| format!("{} s", general(seconds, 6)))
}

/// Date and time of a moment; none where there is no calendar or the moment lies beyond it.
pub(super) fn dated(t0: Option<i64>, seconds: f64) -> Option<String> {
    const DAY: i128 = 86_400_000_000;
    let micros = i128::from(t0?) + libm::rint(seconds * 1e6) as i128;
    let (days, rest) = (micros.div_euclid(DAY), micros.rem_euclid(DAY));
    let (year, month, day) = civil(i64::try_from(days).ok().filter(|_| seconds.is_finite())?);
    if !(1..=9999).contains(&year) {
        return None;
    }
    let (of_day, micros) = (rest / 1_000_000, rest % 1_000_000);
    let (hours, minutes, of_minute) = (of_day / 3600, of_day / 60 % 60, of_day % 60);
    let part = if micros == 0 { String::new() } else { format!(".{:03}", micros / 1000) };
    Some(format!("{year:04}-{month:02}-{day:02} {hours:02}:{minutes:02}:{of_minute:02}{part}"))
}

/// Year, month and day of a day counted from 1970-01-01, in the Gregorian calendar. Eras of 400 years begin on 1 March.
fn civil(days: i64) -> (i64, i64, i64) {
    let since = days + 719_468;
    let (era, of_era) = (since.div_euclid(146_097), since.rem_euclid(146_097));
    let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month = (5 * of_year + 2) / 153;
    let day = of_year - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    (era * 400 + year_of_era + i64::from(month <= 2), month, day)
}

/// A count with its noun.
///
/// ```
/// use glapp_analysis::words::count;
/// assert_eq!((count(1, "detection"), count(1204, "half-period")), ("1 detection".into(), "1204 half-periods".into()));
/// ```
pub fn count(n: i64, noun: &str) -> String {
    format!("{n} {noun}{}", if n == 1 { "" } else { "s" })
}

/// A reason as a sentence: a full stop, and a capital letter unless it starts with a file, a tag or a symbol.
pub fn sentence(text: &str) -> String {
    let first = text.split_whitespace().next().unwrap_or_default();
    let mut sentence_text = text.to_string();
    if !first.is_empty() && first.chars().all(char::is_alphabetic) && text.starts_with(first) {
        let mut letters = text.chars();
        sentence_text =
            letters.next().map_or(String::new(), |letter| letter.to_uppercase().collect::<String>() + letters.as_str());
    }
    if sentence_text.is_empty() || sentence_text.ends_with(['.', '!', '?']) {
        sentence_text
    } else {
        sentence_text + "."
    }
}

/// [s], in seconds however many they are.
pub(super) fn seconds(x: f64) -> String {
    format!("{} s", if x < 1000.0 { general(x, 3) } else { fixed(x, 0) })
}

/// A share in per cent.
pub(super) fn share(x: f64) -> String {
    let percent = if x >= 0.095 || x == 0.0 { fixed(100.0 * x, 0) } else { general(100.0 * x, 2) };
    format!("{percent}\u{a0}%")
}
