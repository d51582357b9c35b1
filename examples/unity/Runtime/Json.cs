using System;
using System.Collections;
using System.Collections.Generic;
using System.Globalization;
using System.Text;

namespace Tensionlab
{
    /// <summary>JSON as text and as values: null, bool, double, string, List of values, Dictionary by name.</summary>
    public static class Json
    {
        public static string Write(object value)
        {
            var text = new StringBuilder();
            Write(value, text);
            return text.ToString();
        }

        /// <summary>Read a text; FormatException if it is no JSON.</summary>
        public static object Read(string text)
        {
            int at = 0;
            object value = ReadValue(text, ref at);
            SkipSpace(text, ref at);
            if (at < text.Length) throw Wrong(text, at);
            return value;
        }

        static void Write(object value, StringBuilder text)
        {
            if (value == null) text.Append("null");
            else if (value is bool) text.Append((bool)value ? "true" : "false");
            else if (value is string) WriteText((string)value, text);
            else if (value is IDictionary<string, object>) WriteMembers((IDictionary<string, object>)value, text);
            else if (value is IEnumerable) WriteEntries((IEnumerable)value, text);
            else WriteNumber(Convert.ToDouble(value, CultureInfo.InvariantCulture), text);
        }

        static void WriteNumber(double number, StringBuilder text)
        {
            if (double.IsNaN(number) || double.IsInfinity(number))
                throw new ArgumentException("JSON has no " + number + "; an effect or a body has one");
            text.Append(number.ToString("R", CultureInfo.InvariantCulture));
        }

        static void WriteMembers(IDictionary<string, object> members, StringBuilder text)
        {
            string between = "{";
            foreach (KeyValuePair<string, object> member in members)
            {
                text.Append(between);
                WriteText(member.Key, text);
                text.Append(':');
                Write(member.Value, text);
                between = ",";
            }
            text.Append(members.Count == 0 ? "{}" : "}");
        }

        static void WriteEntries(IEnumerable entries, StringBuilder text)
        {
            text.Append('[');
            string between = "";
            foreach (object entry in entries)
            {
                text.Append(between);
                Write(entry, text);
                between = ",";
            }
            text.Append(']');
        }

        static void WriteText(string words, StringBuilder text)
        {
            text.Append('"');
            foreach (char letter in words)
            {
                if (letter == '"' || letter == '\\') text.Append('\\').Append(letter);
                else if (letter < ' ') text.Append("\\u").Append(((int)letter).ToString("x4"));
                else text.Append(letter);
            }
            text.Append('"');
        }

        static object ReadValue(string text, ref int at)
        {
            SkipSpace(text, ref at);
            if (at == text.Length) throw Wrong(text, at);
            switch (text[at])
            {
                case '{': return ReadMembers(text, ref at);
                case '[': return ReadEntries(text, ref at);
                case '"': return ReadText(text, ref at);
                case 't': return Word("true", true, text, ref at);
                case 'f': return Word("false", false, text, ref at);
                case 'n': return Word("null", null, text, ref at);
                default: return ReadNumber(text, ref at);
            }
        }

        static Dictionary<string, object> ReadMembers(string text, ref int at)
        {
            var members = new Dictionary<string, object>();
            at++;
            while (!Ends(text, ref at, '}', members.Count == 0))
            {
                SkipSpace(text, ref at);
                if (at == text.Length || text[at] != '"') throw Wrong(text, at);
                string name = ReadText(text, ref at);
                SkipSpace(text, ref at);
                if (at == text.Length || text[at++] != ':') throw Wrong(text, at);
                members[name] = ReadValue(text, ref at);
            }
            return members;
        }

        static List<object> ReadEntries(string text, ref int at)
        {
            var entries = new List<object>();
            at++;
            while (!Ends(text, ref at, ']', entries.Count == 0)) entries.Add(ReadValue(text, ref at));
            return entries;
        }

        // Whether a list ends here; goes over the end, or the comma before the next entry.
        static bool Ends(string text, ref int at, char end, bool first)
        {
            SkipSpace(text, ref at);
            if (at == text.Length) throw Wrong(text, at);
            if (text[at] == end)
            {
                at++;
                return true;
            }
            if (!first && text[at++] != ',') throw Wrong(text, at - 1);
            return false;
        }

        static string ReadText(string text, ref int at)
        {
            var words = new StringBuilder();
            for (at++; at < text.Length && text[at] != '"'; at++)
            {
                if (text[at] != '\\')
                {
                    words.Append(text[at]);
                    continue;
                }
                if (++at == text.Length) break;
                int escape = "\"\\/bfnrt".IndexOf(text[at]);
                if (escape >= 0) words.Append("\"\\/\b\f\n\r\t"[escape]);
                else if (text[at] == 'u' && at + 4 < text.Length)
                {
                    words.Append((char)int.Parse(text.Substring(at + 1, 4), NumberStyles.HexNumber));
                    at += 4;
                }
                else throw Wrong(text, at);
            }
            if (at++ >= text.Length) throw Wrong(text, text.Length);
            return words.ToString();
        }

        static object ReadNumber(string text, ref int at)
        {
            int begin = at;
            while (at < text.Length && "+-.eE0123456789".IndexOf(text[at]) >= 0) at++;
            double number;
            string digits = text.Substring(begin, at - begin);
            if (!double.TryParse(digits, NumberStyles.Float, CultureInfo.InvariantCulture, out number))
                throw Wrong(text, begin);
            return number;
        }

        static object Word(string word, object value, string text, ref int at)
        {
            if (string.CompareOrdinal(text, at, word, 0, word.Length) != 0) throw Wrong(text, at);
            at += word.Length;
            return value;
        }

        static void SkipSpace(string text, ref int at)
        {
            while (at < text.Length && char.IsWhiteSpace(text[at])) at++;
        }

        static FormatException Wrong(string text, int at)
        {
            return new FormatException("no JSON at character " + at + ": " + text.Substring(0, Math.Min(text.Length, 80)));
        }
    }
}
