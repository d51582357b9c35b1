// As much of UnityEngine as examples/unity uses, to compile and run it without Unity. Axes are left-handed, as there.
using System;
using System.Collections.Generic;
using System.Globalization;

namespace UnityEngine
{
    public struct Vector3
    {
        public float x, y, z;

        public Vector3(float x, float y, float z)
        {
            this.x = x;
            this.y = y;
            this.z = z;
        }

        public static Vector3 zero { get { return new Vector3(0, 0, 0); } }
        public static Vector3 one { get { return new Vector3(1, 1, 1); } }
        public static Vector3 up { get { return new Vector3(0, 1, 0); } }
        public static Vector3 down { get { return new Vector3(0, -1, 0); } }
        public static Vector3 right { get { return new Vector3(1, 0, 0); } }
        public static Vector3 forward { get { return new Vector3(0, 0, 1); } }
        public float magnitude { get { return (float)Math.Sqrt(Dot(this, this)); } }

        public static float Dot(Vector3 a, Vector3 b)
        {
            return a.x * b.x + a.y * b.y + a.z * b.z;
        }

        public static Vector3 Cross(Vector3 a, Vector3 b)
        {
            return new Vector3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
        }

        public static Vector3 operator +(Vector3 a, Vector3 b)
        {
            return new Vector3(a.x + b.x, a.y + b.y, a.z + b.z);
        }

        public static Vector3 operator -(Vector3 a, Vector3 b)
        {
            return a + -1f * b;
        }

        public static Vector3 operator *(float factor, Vector3 a)
        {
            return new Vector3(factor * a.x, factor * a.y, factor * a.z);
        }

        public string ToString(string format)
        {
            CultureInfo culture = CultureInfo.InvariantCulture;
            return "(" + x.ToString(format, culture) + ", " + y.ToString(format, culture) + ", " + z.ToString(format, culture) + ")";
        }
    }

    public struct Quaternion
    {
        public float x, y, z, w;

        public Quaternion(float x, float y, float z, float w)
        {
            this.x = x;
            this.y = y;
            this.z = z;
            this.w = w;
        }

        public static Quaternion identity { get { return new Quaternion(0, 0, 0, 1); } }

        public static Quaternion AngleAxis(float degrees, Vector3 axis)
        {
            double half = degrees * Math.PI / 360.0;
            Vector3 part = (float)Math.Sin(half) / axis.magnitude * axis;
            return new Quaternion(part.x, part.y, part.z, (float)Math.Cos(half));
        }

        public static Quaternion Inverse(Quaternion turn)
        {
            return new Quaternion(-turn.x, -turn.y, -turn.z, turn.w);
        }

        public static Quaternion LookRotation(Vector3 forward)
        {
            throw new NotSupportedException("not of this stub");
        }

        public static Vector3 operator *(Quaternion turn, Vector3 vector)
        {
            var axis = new Vector3(turn.x, turn.y, turn.z);
            Vector3 across = 2f * Vector3.Cross(axis, vector);
            return vector + turn.w * across + Vector3.Cross(axis, across);
        }

        public static Quaternion operator *(Quaternion a, Quaternion b)
        {
            Vector3 first = new Vector3(a.x, a.y, a.z), second = new Vector3(b.x, b.y, b.z);
            Vector3 axis = a.w * second + b.w * first + Vector3.Cross(first, second);
            return new Quaternion(axis.x, axis.y, axis.z, a.w * b.w - Vector3.Dot(first, second));
        }
    }

    public class Object
    {
        public virtual string name { get; set; }

        public static T FindObjectOfType<T>() where T : Component
        {
            foreach (Component each in GameObject.Everything)
                if (each is T) return (T)each;
            return null;
        }
    }

    public class Component : Object
    {
        public GameObject gameObject { get; internal set; }
        public Transform transform { get { return gameObject.transform; } }

        public override string name
        {
            get { return gameObject.name; }
            set { gameObject.name = value; }
        }
    }

    public class Transform : Component
    {
        public Vector3 position;
        public Vector3 localScale = Vector3.one;
        public Quaternion rotation = Quaternion.identity;

        public Vector3 up { get { return rotation * Vector3.up; } }
        public Vector3 right { get { return rotation * Vector3.right; } }

        public Vector3 TransformDirection(Vector3 direction)
        {
            return rotation * direction;
        }

        public Vector3 InverseTransformDirection(Vector3 direction)
        {
            return Quaternion.Inverse(rotation) * direction;
        }

        public Vector3 InverseTransformPoint(Vector3 point)
        {
            return InverseTransformDirection(point - position);
        }
    }

    public class MonoBehaviour : Component
    {
    }

    public class Camera : Component
    {
        public static Camera main { get { return null; } }
    }

    public enum PrimitiveType
    {
        Sphere,
        Cube
    }

    public class GameObject : Object
    {
        internal static readonly List<Component> Everything = new List<Component>();
        public Transform transform { get; private set; }

        public GameObject(string name)
        {
            this.name = name;
            transform = AddComponent<Transform>();
        }

        public T AddComponent<T>() where T : Component, new()
        {
            var added = new T { gameObject = this };
            Everything.Add(added);
            return added;
        }

        public static GameObject CreatePrimitive(PrimitiveType type)
        {
            return new GameObject(type.ToString());
        }
    }

    public static class Debug
    {
        public static void LogWarning(object what, Object about)
        {
            Console.WriteLine("warning: " + what);
        }

        public static void LogError(object what, Object about)
        {
            Console.WriteLine("error: " + what);
        }
    }

    public static class Time
    {
        static readonly System.Diagnostics.Stopwatch Watch = System.Diagnostics.Stopwatch.StartNew();
        public static double realtimeSinceStartupAsDouble { get { return Watch.Elapsed.TotalSeconds; } }
    }

    public static class Input
    {
        public static Vector3 mousePosition { get { return Vector3.zero; } }
    }

    public static class Screen
    {
        public static int width { get { return 1; } }
        public static int height { get { return 1; } }
    }

    public static class Mathf
    {
        public static float Clamp(float value, float least, float most)
        {
            return Math.Max(least, Math.Min(most, value));
        }
    }

    public struct Rect
    {
        public Rect(float x, float y, float width, float height)
        {
        }
    }

    public static class GUI
    {
        public static void Label(Rect place, string text)
        {
        }
    }

    [AttributeUsage(AttributeTargets.Class)]
    public class AddComponentMenu : Attribute
    {
        public AddComponentMenu(string path)
        {
        }
    }

    [AttributeUsage(AttributeTargets.Field)]
    public class TooltipAttribute : Attribute
    {
        public TooltipAttribute(string text)
        {
        }
    }

    [AttributeUsage(AttributeTargets.Field)]
    public class MinAttribute : Attribute
    {
        public MinAttribute(float least)
        {
        }
    }
}
