//! Light transport on the CPU: the reference renderer that pictures are judged against.
