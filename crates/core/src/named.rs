//! Enumerations whose variants have a name.

/// An enumeration whose variants have a name, the same in every face of glapp: `Variant => "name"`, or with its number in Structured
/// Text and C, `Variant = 1 => "name"`. It gets `ALL`, its variants in order, and `name`.
///
/// ```
/// glapp_core::named! {
///     /// How a valve fails.
///     #[derive(Clone, Copy, Debug, PartialEq)]
///     pub enum Fails {
///         /// Without air it is open.
///         Open = 1 => "open",
///         /// Without air it is closed.
///         Closed = 2 => "closed",
///     }
/// }
/// assert_eq!(Fails::ALL.map(Fails::name), ["open", "closed"]);
/// ```
#[macro_export]
macro_rules! named {
    ($(#[$meta:meta])* pub enum $of:ident {
        $($(#[$about:meta])* $variant:ident $(= $number:literal)? => $name:literal,)+
    }) => {
        $(#[$meta])*
        pub enum $of {
            $($(#[$about])* $variant $(= $number)?,)+
        }

        impl $of {
            /// All of them, in order.
            pub const ALL: [Self; [$($name),+].len()] = [$(Self::$variant),+];

            /// The name used in every face of glapp.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)+
                }
            }
        }
    };
}
