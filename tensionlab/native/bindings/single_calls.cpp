// Single problems for Python, where making arrays and results takes longer than to solve: through NumPy's own
// interface in C, and with the result's fields set from here.
#define NPY_NO_DEPRECATED_API NPY_2_0_API_VERSION
#include <numpy/arrayobject.h>
// NumPy's header comes first, as it includes Python's.
#include <algorithm>
#include <array>
#include <memory>
#include <vector>

#include "bindings/arrays.hpp"
#include "bindings/bindings.hpp"
#include "solvers/tension_solver.hpp"

namespace tensionlab {
namespace {

// The numbers of a plain array of float64, contiguous and aligned, with these axes; null of anything else.
template <std::size_t Axes>
const double* numbers_of(nb::handle object, std::array<std::size_t, Axes>& shape) {
  if (!PyArray_CheckExact(object.ptr())) return nullptr;
  auto* array = reinterpret_cast<PyArrayObject*>(object.ptr());
  if (PyArray_NDIM(array) != Axes || PyArray_TYPE(array) != NPY_DOUBLE || !PyArray_ISCARRAY_RO(array)) {
    return nullptr;
  }
  for (int axis = 0; axis < static_cast<int>(Axes); ++axis) {
    shape[axis] = static_cast<std::size_t>(PyArray_DIM(array, axis));
  }
  return static_cast<const double*>(PyArray_DATA(array));
}

bool to_number(PyObject* object, double& number) {
  if (!PyFloat_Check(object) && !PyLong_CheckExact(object)) return false;
  number = PyFloat_AsDouble(object);
  if (!PyErr_Occurred()) return true;
  PyErr_Clear();
  return false;
}

// The numbers of a plain array, of a list or, where one is for all, of a single number, written to the buffer if
// they are no array; null of anything else.
const double* vector_of(nb::handle object, std::size_t size, bool one_for_all, double* buffer) {
  std::array<std::size_t, 1> length{};
  if (const double* numbers = numbers_of(object, length)) return length[0] == size ? numbers : nullptr;
  if (one_for_all && to_number(object.ptr(), buffer[0])) {
    std::fill_n(buffer + 1, size - 1, buffer[0]);
    return buffer;
  }
  if (!PyList_CheckExact(object.ptr()) || static_cast<std::size_t>(PyList_GET_SIZE(object.ptr())) != size) {
    return nullptr;
  }
  for (std::size_t i = 0; i < size; ++i) {
    if (!to_number(PyList_GET_ITEM(object.ptr(), static_cast<Py_ssize_t>(i)), buffer[i])) return nullptr;
  }
  return buffer;
}

nb::object own(PyObject* made) {
  if (made == nullptr) throw nb::python_error();
  return nb::steal(made);
}

// A new vector, and its numbers.
nb::object make_vector(int size, double*& numbers) {
  const npy_intp length = size;
  nb::object vector = own(PyArray_SimpleNew(1, &length, NPY_DOUBLE));
  numbers = static_cast<double*>(PyArray_DATA(reinterpret_cast<PyArrayObject*>(vector.ptr())));
  return vector;
}

// One of NumPy's scalars.
template <class Number>
nb::object to_scalar(Number number, int type) {
  const nb::object described = own(reinterpret_cast<PyObject*>(PyArray_DescrFromType(type)));
  return own(PyArray_Scalar(&number, reinterpret_cast<PyArray_Descr*>(described.ptr()), nullptr));
}

nb::object intern(const char* word) { return own(PyUnicode_InternFromString(word)); }

// Solves single problems. Its results are of the class in Python, whose initialiser takes longer than all of this
// and is not called.
struct SingleSolver {
  const TensionSolver solver;
  AllocationSettings settings;
  nb::object type, lower = intern("lower"), upper = intern("upper");
  static constexpr std::size_t kFields = 8;
  nb::object names[kFields] = {intern("tensions"), intern("wrench"),     intern("residual"),   intern("status"),
                               intern("scale"),    intern("iterations"), intern("separation"), intern("failures")};

  SingleSolver(const TensionSolver& tension_solver, int rule, double largest, double tolerance,
               double rank_tolerance, const nb::object& result)
      : solver(tension_solver), settings{to_rule(rule), largest, tolerance, rank_tolerance}, type(result) {
    require(PyType_Check(type.ptr()), "the result must be a class");
    // Not when the module is loaded: a stop of modules does without NumPy.
    if (PyArray_ImportNumPyAPI() < 0) throw nb::python_error();
  }

  // None if a number is not finite or too large.
  nb::object solve(Rule rule, int n, int m, const Problem<double>& problem, const double* weights) const {
    const Batch batch = batch_of_one(n, m, problem, weights);
    AllocationSettings own_settings = settings;
    own_settings.rule = rule;
    double residual, scale, *tensions, *rendered, *separation;
    std::int8_t status;
    std::int64_t iterations;
    const nb::object chosen = make_vector(m, tensions), wrench = make_vector(n, rendered),
                     direction = make_vector(n, separation);
    const SweepAnswer answer{tensions, separation, rendered, &residual, &scale, &status, &iterations};
    std::atomic<bool> flawed{false};
    bool valid = false;
    const auto allocate = [&](std::size_t begin, std::size_t end) {
      valid = solver.allocate(batch, own_settings, begin, end, answer, flawed);
    };
    solver.brief ? allocate(0, 1) : share_out(1, allocate);
    if (!valid) return nb::none();
    nb::dict failures;
    if (status == static_cast<std::int8_t>(Status::failed)) {
      failures[nb::int_(0)] = nb::str(solver.failure(problem, n, m).c_str());
    }
    const nb::object values[kFields] = {chosen,
                                        wrench,
                                        to_scalar(residual, NPY_DOUBLE),
                                        to_scalar(status, NPY_INT8),
                                        to_scalar(scale, NPY_DOUBLE),
                                        to_scalar(iterations, NPY_INT64),
                                        direction,
                                        failures};
    const nb::object result = own(PyType_GenericAlloc(reinterpret_cast<PyTypeObject*>(type.ptr()), 0));
    for (std::size_t k = 0; k < kFields; ++k) {
      if (PyObject_SetAttr(result.ptr(), names[k].ptr(), values[k].ptr()) != 0) throw nb::python_error();
    }
    return result;
  }
};

using Vector = Contiguous<double, 1>;
using Sizes = std::array<std::size_t, 2>;

// A function of structure and wrench, with these limits, reference (m) and weights (n). It returns None where the
// two are anything but plain arrays, or the wrench a list, of the right shapes and of finite numbers.
nb::object prepare_call(const TensionSolver& solver, const Vector& lower, const Vector& upper,
                        const Vector& reference, const Vector& weights, int rule, double largest, double tolerance,
                        double rank_tolerance, const nb::object& result) {
  require_size(weights.size(), lower.size());
  require(upper.size() == lower.size() && reference.size() == lower.size(),
          "limits and reference have not the same length");
  struct Call {
    SingleSolver single;
    std::vector<double> lower, upper, reference, weights;
  };
  const auto call = std::make_shared<const Call>(Call{{solver, rule, largest, tolerance, rank_tolerance, result},
                                                      to_vector(lower),
                                                      to_vector(upper),
                                                      to_vector(reference),
                                                      to_vector(weights)});
  return nb::cpp_function(
      [call](nb::handle structure, nb::handle wrench) {
        const std::size_t n = call->weights.size(), m = call->lower.size();
        Sizes shape{};
        double components[kMaxComponents];
        const double *matrix = numbers_of(structure, shape), *desired = vector_of(wrench, n, false, components);
        if (matrix == nullptr || desired == nullptr || shape != Sizes{n, m}) return nb::object(nb::none());
        return call->single.solve(
            call->single.settings.rule, static_cast<int>(n), static_cast<int>(m),
            {matrix, desired, call->lower.data(), call->upper.data(), call->reference.data()},
            call->weights.data());
      },
      nb::arg().none(), nb::arg().none());
}

bool is(nb::handle object, const char* word) {
  return PyUnicode_CheckExact(object.ptr()) && PyUnicode_CompareWithASCIIString(object.ptr(), word) == 0;
}

// The number of a policy's rule, -1 of an unknown one.
int rule_of(const nb::dict& rules, nb::handle policy) {
  if (!policy.is_none() && !PyUnicode_CheckExact(policy.ptr())) return -1;
  PyObject* rule = PyDict_GetItemWithError(rules.ptr(), policy.ptr());
  return rule == nullptr ? -1 : nb::cast<int>(nb::handle(rule));
}

// A function of structure, wrench, limits (a pair, or an object that has both), reference (None, "lower" or
// "middle") and policy (a key of the rules). It returns None where anything is not of the plainest kind, or not
// valid, and where refuses, unless None, gives a reason for n components and m cables.
nb::object unprepared_call(const TensionSolver& solver, const nb::dict& rules, const nb::object& refuses,
                           double largest, double tolerance, double rank_tolerance, const nb::object& result) {
  const auto single = std::make_shared<const SingleSolver>(solver, 0, largest, tolerance, rank_tolerance, result);
  return nb::cpp_function(
      [single, rules, refuses](nb::handle structure, nb::handle wrench, nb::handle limits, nb::handle reference,
                               nb::handle policy) {
        const nb::object refused = nb::none();
        const bool pair = PyTuple_CheckExact(limits.ptr());
        if (pair && nb::len(limits) != 2) return refused;
        const nb::object least = pair ? limits[0] : nb::getattr(limits, single->lower, refused);
        const nb::object most = pair ? limits[1] : nb::getattr(limits, single->upper, refused);
        Sizes shape{};
        const double* matrix = numbers_of(structure, shape);
        const auto [n, m] = shape;
        if (matrix == nullptr || n < 1 || n > kMaxComponents || m < 1 || m > kMaxCables) return refused;
        double components[kMaxComponents], below[kMaxCables], above[kMaxCables];
        const double* desired = vector_of(wrench, n, false, components);
        const double *lower = vector_of(least, m, true, below), *upper = vector_of(most, m, true, above);
        const bool at_lower = is(reference, "lower"), at_middle = is(reference, "middle");
        const int rule = rule_of(rules, policy);
        if (desired == nullptr || lower == nullptr || upper == nullptr || rule < 0 ||
            !(reference.is_none() || at_lower || at_middle) || !(refuses.is_none() || refuses(n, m).is_none())) {
          return refused;
        }
        double start[kMaxCables], weights[kMaxComponents];
        for (std::size_t i = 0; i < m; ++i) {
          const double most_allowed = single->settings.largest;
          if (!(-most_allowed < lower[i] && lower[i] <= upper[i] && upper[i] < most_allowed)) return refused;
          start[i] = at_lower ? lower[i] : at_middle ? (lower[i] + upper[i]) / 2 : 0.0;
        }
        std::fill_n(weights, n, 1.0);
        return single->solve(to_rule(rule), static_cast<int>(n), static_cast<int>(m),
                             {matrix, desired, lower, upper, start}, weights);
      },
      nb::arg().none(), nb::arg().none(), nb::arg().none(), nb::arg().none(), nb::arg().none());
}

}  // namespace

void bind_single_calls(nb::module_& module) {
  module.def("prepare_call", &prepare_call);
  module.def("unprepared_call", &unprepared_call, nb::arg(), nb::arg(), nb::arg().none(), nb::arg(), nb::arg(),
             nb::arg(), nb::arg());
}

}  // namespace tensionlab
